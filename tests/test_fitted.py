"""Fitted numbers: files with the command and the date, and what is refused in them."""

import datetime
import sys

import numpy as np
import pytest
import yaml

from grasptransfer.category import objects_folder
from grasptransfer.errors import GraspFileError
from grasptransfer.fitted import Fit, read_fits, write_fits
from grasptransfer.grasping.success_model import BLOCKS, WEIGHTS, Ranking, write_ranking
from grasptransfer.yaml_models import parse


def test_shipped_numbers_say_by_which_command_and_when_they_were_fitted():
    for path in sorted((objects_folder() / "models").glob("*.yaml")):
        for name, block in yaml.safe_load(path.read_text()).items():
            fit = parse(Fit, block, path, key=name, error=GraspFileError)
            assert fit.command
            assert datetime.date.fromisoformat(fit.date) > datetime.date(2026, 1, 1)


def test_every_weight_file_has_its_numbers_beside_it():
    found = {path.stem for path in (objects_folder() / "models").glob("*.yaml")}
    trained = {path.stem for path in (objects_folder() / "models").glob("*.safetensors")}
    assert found == trained | {"ranking", "experience", "poses"}


def test_a_fitted_ranking_comes_back_with_the_command_that_wrote_it(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/bin/grasptransfer", "bench", "calibration", "--json", "a b.json"])
    write_ranking(np.arange(6.0) / 3, path=tmp_path / "ranking.yaml")
    fit = read_fits(tmp_path / "ranking.yaml", BLOCKS, error=GraspFileError)["ranking"]
    assert fit.command == "grasptransfer bench calibration --json 'a b.json'"
    assert fit.date == datetime.date.today().isoformat()
    np.testing.assert_allclose(Ranking(**fit.values).weights, np.arange(6.0) / 3, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda values: values.pop("moment"), "moment"),
        (lambda values: values.update(luck=1.0), "luck"),
        (lambda values: values.update(moment="much"), "moment"),
        (lambda values: values.update(moment=float("nan")), "moment"),
    ],
)
def test_a_number_that_is_missing_unknown_or_none_is_named(tmp_path, change, said):
    path = tmp_path / "ranking.yaml"
    write_fits(path, {"ranking": Fit.today(dict.fromkeys(WEIGHTS, 1.0))})
    data = yaml.safe_load(path.read_text())
    change(data["ranking"]["values"])
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(GraspFileError, match=rf"ranking\.yaml.*{said}"):
        read_fits(path, BLOCKS, error=GraspFileError)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(GraspFileError, match=r"ranking\.yaml"):
        read_fits(tmp_path / "ranking.yaml", BLOCKS, error=GraspFileError)
