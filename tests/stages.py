"""USD files as the validators see them."""

from pxr import Usd, UsdValidation


def opened(path):
    """The stage of a file in which no validator finds anything."""
    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert validators
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in found] == []
    return stage
