"""Plans and results of studies formatted as lines of text for a terminal."""

from asfm.commands.study import StudyPlan, StudySummary
from asfm.commands.text import align
from asfm.study.report.summary_table import COLUMNS, format_summary, note_unequal_cells

MAX_ERRORS = 5
"""Failed cells that are named; all of them are in the tables."""


def describe_plan(plan: StudyPlan) -> list[str]:
    """Format the axes of a grid, the number of its cells and the estimated time."""
    study, estimate = plan.study, plan.estimate
    simulated = study.simulate
    axes = [("sequences", list(study.sequences))]
    if simulated is not None:
        axes += [("scenes", list(simulated.scenes)), ("sonars", list(simulated.sonars))]
        axes += [("motions", [motion or "the scene's own" for motion in simulated.motions])]
        axes += [("scene seeds", [str(seed) for seed in simulated.scene_seeds]), ("frames", [str(simulated.frames)])]
    axes += [("seeds", [str(seed) for seed in study.seeds]), ("modes", list(study.modes))]
    axes += [("detectors", list(study.detectors)), ("learned", list(study.learned))]
    axes += [("external", [matcher.name for matcher in study.external])]
    axes += [("filters", [f"{name} ({', '.join(chain)})" for name, chain in study.filters.items()])]
    axes += [("back-ends", list(study.backend))]
    if study.corruption is not None:
        for name, values in vars(study.corruption).items():
            if isinstance(values, tuple):
                axes.append((f"corruption, {name}", [str(value) for value in values]))
    lines = align([(name, ", ".join(values)) for name, values in axes if values])
    passes = f"{_count(estimate.sequences, 'sequence')}, front-end passes: {estimate.features}"
    lines.append(f"{_count(estimate.cells, 'cell')}, {passes}; about {_format_hours(estimate.hours)} on one core")
    return [
        *lines,
        *(f"cells that would fail: {reason}" for reason in plan.failing),
        *(f"external matcher: the Python function {name} is code, and it would be run" for name in plan.functions),
    ]


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _format_hours(hours: float) -> str:
    return f"{hours:.1f} hours" if hours >= 1 else _count(max(round(60 * hours), 1), "minute")


def describe_study(summary: StudySummary) -> list[str]:
    """Format the means of a study, its law, the cells that failed, and where the report is."""
    lines = []
    if summary.summary:
        headings, cells = format_summary(summary.summary)
        texts = {heading for heading, form in COLUMNS.values() if not form}
        numbers = [column for column, heading in enumerate(headings) if heading not in texts]
        lines += align([headings, *cells], numbers)
    lines += [f"note: {note}"] if (note := note_unequal_cells(summary.rows)) else []
    lines += [] if summary.law is None else ["", *summary.law.describe()]
    failed = [row for row in summary.rows if row["error"]]
    for row in failed[:MAX_ERRORS]:
        where = ", ".join(str(row[name]) for name in ("sequence", "detector", "filters", "mode"))
        lines.append(f"failed: {where}, seed {row['seed']}: {row['error']}")
    count = f"{_count(len(summary.rows), 'cell')}, {summary.computed} computed now, {len(failed)} failed"
    return [*lines, count, f"report: {summary.folder / 'report.html'}"]
