"""What all checks have in common."""

import functools
from collections.abc import Callable


class CheckFailed(AssertionError):
    """The answer is wrong; the text says in what."""

    def _render_traceback_(self) -> list[str]:
        """Show a notebook's reader this sentence alone: the lines of the check would give the answer away."""
        return [f"Not yet: {self}"]


def check(compare: Callable[[Callable], None]) -> Callable[[Callable], None]:
    """Turn a function that asserts what is true of an answer into a check.

    Args:
        compare: takes the reader's function and asserts, each time with a sentence that says what is wrong.

    Returns:
        The check. It prints "correct", or raises CheckFailed.
    """

    @functools.wraps(compare)
    def run(answer: Callable) -> None:
        if not callable(answer):
            raise CheckFailed(f"hand over the function {compare.__name__} itself, without calling it")
        try:
            compare(answer)
        except AssertionError as failure:
            raise CheckFailed(str(failure)) from None
        print("correct")

    return run
