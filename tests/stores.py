"""An object store on this computer: moto's server, which answers as S3 does, on a port of the system's choice."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from urllib.request import Request, urlopen

import pytest

BUCKET = "trials"
needs_store = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("moto", "s3fs", "flask")),
    reason="moto[server] and s3fs are not installed",
)


@contextmanager
def object_store() -> Iterator[str]:
    """The address of an empty store with the bucket :data:`BUCKET`; the environment names it and credentials."""
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = import_module("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "crew")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "aboard")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        clear_connections()
        urlopen(Request(f"http://{host}:{port}/moto-api/reset", method="POST")).close()  # one store a process
        import_module("fsspec").filesystem("s3").mkdir(BUCKET)
        try:
            yield f"http://{host}:{port}"
        finally:
            clear_connections()
            server.stop()


def clear_connections() -> None:
    """Forget connections to stores, which are kept for as long as a process runs."""
    import_module("s3fs").S3FileSystem.clear_instance_cache()


def put(path: Path, name: str) -> str:
    """Put a file into the bucket; its address."""
    import_module("fsspec").filesystem("s3").put_file(str(path), f"{BUCKET}/{name}")
    return f"s3://{BUCKET}/{name}"


def every_tenth_fails(patch: pytest.MonkeyPatch) -> list[int]:
    """Have every tenth request to the store fail, the first of them the fifth; the numbers of those that did."""
    system, failures, numbers = import_module("s3fs").S3FileSystem, list[int](), count()
    call = system._call_s3

    async def fail_sometimes(*arguments: object, **options: object) -> object:
        if (number := next(numbers)) % 10 == 4:
            failures.append(number)
            raise ConnectionResetError("connection reset by peer")
        return await call(*arguments, **options)

    patch.setattr(system, "_call_s3", fail_sometimes)
    return failures
