"""evaluation.json: the pose errors of a run."""

from pathlib import Path

from asfm.errors import AsfmError
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.results.json_file import write_json
from asfm.results.results_folder import EVALUATION, EVALUATION_PARTIAL


def write_evaluation(folder: Path, table: EvaluationTable) -> None:
    """Write or replace the evaluation in a results folder; an interruption leaves the old file intact.

    Raises:
        AsfmError: the file cannot be written.
    """
    path, partial = folder / EVALUATION, folder / EVALUATION_PARTIAL
    try:
        write_json(partial, table.as_dict())
        partial.replace(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)
