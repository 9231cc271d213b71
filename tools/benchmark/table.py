"""Table of measured numbers beside what is required of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asfm.commands.text import align


@dataclass(frozen=True)
class Requirement:
    """One measured number and its limits."""

    what: str
    reached: float | None
    """None where there was nothing to measure."""
    unit: str = ""
    at_most: float | None = None
    at_least: float | None = None
    """Without either limit nothing is required: the number is there to compare with."""

    @property
    def ok(self) -> bool | None:
        """Whether the number is within its limits; None where nothing is required."""
        if self.at_most is None and self.at_least is None:
            return None
        if self.reached is None:
            return False
        too_large = self.at_most is not None and self.reached > self.at_most
        return not too_large and (self.at_least is None or self.reached >= self.at_least)

    def cells(self) -> tuple[str, str, str, str, str]:
        """Return what, asked, reached, unit, ok as text."""
        limit, sign = (self.at_least, "≥") if self.at_most is None else (self.at_most, "≤")
        asked = "" if limit is None else f"{sign} {limit:.3g}" if limit < 1000 else f"{sign} {limit:,.0f}"
        if self.at_most is not None and self.at_least is not None:
            asked = f"{self.at_least:.3g} to {self.at_most:.3g}"
        reached = "-" if self.reached is None else f"{self.reached:.3g}"
        if self.reached is not None and np.isfinite(self.reached) and abs(self.reached) >= 1000:
            reached = f"{self.reached:,.0f}"
        return self.what, asked, reached, self.unit, {None: "", True: "yes", False: "NO"}[self.ok]


def tabulate(numbers: Sequence[Requirement]) -> list[str]:
    """Return the lines of the table."""
    return align([("what", "asked", "reached", "", "ok"), *(number.cells() for number in numbers)], numbers=(1, 2))
