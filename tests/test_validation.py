"""Every validation case is a test, its limits included."""

import pytest

from warpdem.validation import cases


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, id=c.name, marks=[pytest.mark.slow] * c.slow) for c in cases()],
)
def test_case(case):
    checks = case.run()
    missed = [c for c in checks if not c.passed]
    assert checks
    assert not missed, "\n".join(f"{c.quantity}: {c.error:.3g} > {c.limit:.3g}" for c in missed)
