import pytest
import warp as wp


def pytest_collection_modifyitems(items):
    """Tests of a GPU skip themselves where there is none."""
    if wp.is_cuda_available():
        return
    for item in items:
        if item.get_closest_marker("gpu"):
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))
