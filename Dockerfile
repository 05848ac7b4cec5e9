# grasp-factory with the page in the browser:
#   docker build -t grasp-factory .
#   docker run --rm -v "$PWD:/data" grasp-factory generate --n 100 --out grasps.zarr
FROM python:3.11-slim
WORKDIR /src
COPY setup.cfg pyproject.toml MANIFEST.in README.md LICENSE ./
COPY grasp_factory ./grasp_factory
RUN pip install --no-cache-dir '.[browse,plot]' && rm -rf /src
RUN useradd --create-home grasp
USER grasp
WORKDIR /data
ENTRYPOINT ["grasp-factory"]
