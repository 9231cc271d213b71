"""The results folder: names and patterns of its files agree."""

from asfm.results import results_folder
from asfm.results.results_folder import RESULTS


def test_every_file_name_belongs_to_the_folder() -> None:
    names = {value for key, value in vars(results_folder).items() if key.isupper() and isinstance(value, str)}
    assert names == set(RESULTS.patterns)
    assert set(RESULTS.marks) <= set(RESULTS.patterns)
