"""Making stores in object storage: on the local disk first, then object by object, each once."""

from grasp_factory.curation.upload.remote_run import generate_there, pack_there
from grasp_factory.curation.upload.uploading import Uploaded, upload

__all__ = ["Uploaded", "generate_there", "pack_there", "upload"]
