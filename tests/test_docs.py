"""README and docs: their code runs, their links lead somewhere, their figures are those of the documents."""

import re
from pathlib import Path

import numpy as np
import pytest

from grasptransfer.workshop import figures

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCKS = [
    pytest.param(block, id=f"{page.name}-{number}")
    for page in PAGES
    for number, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.S))
]


def _ball_and_egg() -> dict:
    """Names that the code of the registration page takes for granted."""
    import trimesh

    mesh = trimesh.creation.icosphere(3, 0.05)
    points = np.asarray(mesh.vertices)
    eggs = [points * (1, 1, 1 + 0.1 * number) for number in range(1, 5)]
    part = eggs[0][eggs[0][:, 0] > 0]
    return {"points": points, "target": eggs[0], "targets": eggs, "mesh": mesh, "part": part} | {
        "eye": np.array([0.5, 0.0, 0.0])
    }


@pytest.mark.parametrize("block", BLOCKS)
def test_a_code_block_runs(block, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    for folder in ("objects", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    names = _ball_and_egg() if "registration" in block else {}
    exec(compile(block, "block", "exec"), names)
    assert capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_lead_somewhere(page):
    for target in re.findall(r"\]\((?!http|#)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 140


def test_the_pages_hold_the_figures_of_the_documents():
    documents = figures.read_documents()
    assert documents
    assert (ROOT / figures.PAGE).read_text() == figures.figures_page(documents)
    readme = (ROOT / figures.README).read_text()
    assert readme == figures.with_figures(readme, documents)


def test_a_document_is_kept_without_what_is_listed_for_every_view(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "DOCUMENTS", tmp_path / "kept")
    row = {"category": "mug", "instance": "a", "views": 2, "rgb": {"mean": 3.0, "E": [2.0, 4.0]}}
    document = {"benchmark": "registration", "settings": {"views": 2}, "machine": {"cores": 2}}
    path = tmp_path / "shapes.json"
    import json

    path.write_text(json.dumps({**document, "rows": [row], "summary": {"E": 3.0}}))
    figures.keep_documents([path])
    ((name, kept),) = figures.read_documents()
    assert (name, kept["rows"][0]["rgb"], kept["summary"]) == ("shapes", {"mean": 3.0}, {"E": 3.0})
    assert "| mug (1) | 3 |" in figures.figures_page([(name, kept)])
