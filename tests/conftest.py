import os

# tests share the cores among them, so that linear algebra need not
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import pytest  # noqa: E402
import warp as wp  # noqa: E402

from warpdem import passes  # noqa: E402


@pytest.fixture
def two_threads(monkeypatch):
    """Two threads, which take turns where there is one core."""
    cores = passes.cores()
    monkeypatch.setattr(passes, "cores", lambda: max(2, cores))


def pytest_collection_modifyitems(items):
    """Tests of a GPU skip themselves where there is none."""
    if wp.is_cuda_available():
        return
    for item in items:
        if item.get_closest_marker("gpu"):
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))
