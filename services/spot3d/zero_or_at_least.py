"""Settings that are off at 0, and otherwise not so small that nothing can be computed with them."""

from pydantic import AfterValidator


def zero_or_at_least(least: float) -> AfterValidator:
    """The check of a setting, in its own unit; raises ValueError for what is between 0 and `least`."""

    def check(value: float) -> float:
        if 0 < value < least:
            raise ValueError(f"must be 0 (off) or at least {least:g}")
        return value

    return AfterValidator(check)
