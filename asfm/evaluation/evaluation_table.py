"""Evaluation table: the measures of a run, each with a stable key, a name, a value and a unit."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EvaluationRow:
    """One measure of quality."""

    key: str
    """Stable name for programs: measure_unit_alignment, as in ``ate_rmse_m_se3``; ratios have no unit."""
    name: str
    """Name for readers; states the alignment and that the scale is off, wherever a pose error depends on them."""
    value: float
    unit: str
    odometry: float | None = None
    """The same measure of the odometry alone; None without odometry."""
    ratio: float | None = None
    """value / odometry: below one where the run improves on its odometry; None where they cannot be compared."""
    detail: bool = False
    """Whether the measure stands in evaluation.json alone and is not printed."""


@dataclass(frozen=True)
class EvaluationTable:
    """All measures of one run."""

    rows: tuple[EvaluationRow, ...]
    notes: tuple[str, ...] = ()
    """Limits of the comparison, one sentence each."""
    reference: str | None = None
    """File of true poses that took the place of the sequence's own."""

    def as_dict(self) -> dict[str, object]:
        """Return the content of evaluation.json; every number is finite."""
        rows = [vars(row).copy() for row in self.rows]
        return {"rows": rows, "notes": list(self.notes), "reference": self.reference}

    def row(self, key: str) -> EvaluationRow:
        """Return the row with a key.

        Raises:
            KeyError: no row has that key.
        """
        for row in self.rows:
            if row.key == key:
                return row
        raise KeyError(key)
