# grasp-factory with the page in the browser: docs/guides/installing.md says how to use it, and
# bin/check-image builds it and runs the main commands in it.
FROM python:3.11-slim
WORKDIR /src
COPY setup.cfg pyproject.toml MANIFEST.in README.md LICENSE ./
COPY grasp_factory ./grasp_factory
RUN pip install --no-cache-dir '.[browse,plot]' && rm -rf /src
RUN useradd --create-home grasp && chmod 1777 /home/grasp
# Also for `--user`, whose number has no home of its own.
ENV HOME=/home/grasp
USER grasp
WORKDIR /data
ENTRYPOINT ["grasp-factory"]
