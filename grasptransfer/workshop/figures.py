"""The page of figures and the README's table, made from the benchmark documents that lie beside the weights.

`python -m grasptransfer.workshop.figures` writes both. `--keep JSON …` first takes new documents in, without
the errors of every single view. A test compares both pages with the documents.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from grasptransfer.category import objects_folder
from grasptransfer.errors import SettingsError
from grasptransfer.files import write_whole

DOCUMENTS = objects_folder() / "models" / "figures"
PAGE, README = Path("docs/figures.md"), Path("README.md")
START, END = "<!-- figures: python -m grasptransfer.workshop.figures -->", "<!-- end of figures -->"
TESTED = "<!-- tested: python -m grasptransfer.workshop.soak summary -->", "<!-- end of tested -->"
ESTIMATORS = ("gt", "rgb", "rgbd", "cls", "cpd", "similarity", "rigid")
NAMES = {"gt": "true field", "cls": "CLS (depth)", "cpd": "CPD (depth)", "rgbd": "rgbd (depth)"}
FOLDERS = {"meshes", "photos", "weights", "data"}
UNTOLD = ("weights", "meshes", "photos", "seed", "categories", "methods", "estimators")


@dataclass(frozen=True)
class FigureSettings:
    """What is written.

    Args:
        keep: documents of `grasptransfer bench … --json` to take in, under their file names.
        root: folder of the README and of docs/.
    """

    keep: tuple[Path, ...] = ()
    root: Path = Path()


def keep_documents(paths: Sequence[Path]) -> None:
    """Copy benchmark documents beside the weights, without what is listed for every view.

    Raises:
        SettingsError: a file is no document of a benchmark that has a table.
    """
    for path in paths:
        document = json.loads(path.read_text())
        if document.get("benchmark") not in TABLES:
            raise SettingsError("is no benchmark with a table", path=path, choices=TABLES)
        for key in (
            FOLDERS & document["settings"].keys()
        ):  # Where data lie on this machine is nobody's concern.
            folder = document["settings"][key]
            document["settings"][key] = None if folder is None else "own data"
        text = json.dumps(_slim(document), indent=1)
        write_whole(DOCUMENTS / path.name, f"{text}\n".encode())


def figures_page(documents: Sequence[tuple[str, dict]]) -> str:
    """The page: a section for every document, in the order given."""
    parts = [
        "# Figures\n",
        "Made from the documents in `objects/models/figures/` by `python -m grasptransfer.workshop.figures`. "
        "E is the paper's error, the mean squared distance from the true surface to the reconstruction, in "
        "1e-6 m². `best-ranked` is the share of views whose best-ranked grasp held; a view without a usable "
        "grasp counts as lost.\n",
    ]
    for name, document in documents:
        parts.append(
            f"## {name}\n\n{_settings_line(document)}\n\n{TABLES[document['benchmark']](document)}\n"
        )
    return "\n".join(parts)


def read_documents() -> list[tuple[str, dict]]:
    """Name and content of every document, by name."""
    return [(path.stem, json.loads(path.read_text())) for path in sorted(DOCUMENTS.glob("*.json"))]


def with_figures(readme: str, documents: Sequence[tuple[str, dict]]) -> str:
    """The README with its tables made anew; what long runs tested, too, once they were kept.

    Raises:
        SettingsError: it holds no place for a table.
    """
    readme = _with_table(readme, START, END, _readme_table(documents))
    for _, document in documents:
        if document["benchmark"] == "soak":
            readme = _with_table(readme, *TESTED, _soak_table(document))
    return readme


def _with_table(readme: str, start: str, end: str, table: str) -> str:
    if start not in readme or end not in readme:
        raise SettingsError("holds no place for the table", path=README, key=start)
    before, rest = readme.split(start)
    _, after = rest.split(end)
    return f"{before}{start}\n\n{table}\n\n{end}{after}"


def _slim(value):
    """Without lists of one entry for each view or grasp."""
    if isinstance(value, dict):
        return {
            key: _slim(inner)
            for key, inner in value.items()
            if key not in ("E", "best", "executed") or not isinstance(inner, list)
        }
    return [_slim(inner) for inner in value] if isinstance(value, list) else value


def _settings_line(document: dict) -> str:
    kept = {k: v for k, v in document["settings"].items() if k not in UNTOLD and v not in (None, [], ())}
    settings = ", ".join(f"{key} {value}" for key, value in kept.items())
    machine = ", ".join(str(value) for value in document["machine"].values())
    return f"`bench {document['benchmark']}`: {settings}. Machine: {machine}."


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _registration_table(document: dict) -> str:
    rows = document["rows"]
    methods = [name for name in ESTIMATORS if name in rows[0]]
    categories = list(dict.fromkeys(row["category"] for row in rows))
    groups = [(name, [row for row in rows if row["category"] == name]) for name in categories]
    if len(groups) > 1:
        groups.append(("all", rows))
    lines = [
        [f"{name} ({len(group)})", *(_number(_mean(row[m]["mean"] for row in group)) for m in methods)]
        for name, group in groups
    ]
    return _table(["mean E", *(NAMES.get(name, name) for name in methods)], lines)


def _grasp_table(document: dict) -> str:
    summary = document["summary"]
    methods = [name for name in ESTIMATORS if f"success_{name}" in summary]
    lines = [
        [text, *(_share(summary.get(f"{key}_{name}")) for name in methods)]
        for text, key in (
            ("best-ranked grasp, held", "top1"),
            ("what was stated of it", "stated"),
            ("grasps called usable, held", "usable_precision"),
            ("all annotated grasps, held", "success"),
        )
    ]
    lines = [line for line in lines if any(cell != "" for cell in line[1:])]
    held = _table([f"{summary['trials']} trials", *(NAMES.get(name, name) for name in methods)], lines)
    rows = [row for row in document["rows"] if row["estimator"] == "rgb"]
    categories = list(dict.fromkeys(row["category"] for row in rows))
    by_category = [
        [name, _share(_mean(row["top1"] for row in rows if row["category"] == name))] for name in categories
    ]
    return held + "\n\n" + _table(["rgb by category", "best-ranked, held"], by_category)


def _photo_table(document: dict) -> str:
    rows = document["rows"]
    lines = []
    for name in ESTIMATORS:
        found = [row[name] for row in rows if name in row]
        if found:
            executed = [one for one in found if "grasp_held" in one]
            stated = [one["grasp_stated"] for one in executed if one.get("grasp_stated") is not None]
            errors = [one["E"] for one in found if one.get("E") is not None]
            lines.append(
                [
                    NAMES.get(name, name),
                    _number(_mean(errors)),
                    f"{sum(bool(one['grasp_held']) for one in executed)} of {len(executed)}",
                    _share(_mean(stated)),
                ]
            )
    heads = [f"{len(rows)} photographs", "mean E", "best-ranked grasp held", "stated"]
    reliability = document["summary"].get("reliability_rgb")
    return _table(heads, lines) + (f"\n\n{_reliability(reliability)}" if reliability else "")


def _reliability(rows: list[dict]) -> str:
    """Stated chances beside the shares that held, tenth by tenth."""
    lines = [
        [
            f"{row['from']:.2f} to {row['to']:.2f}",
            str(row["grasps"]),
            _share(row["stated"]),
            _share(row["held"]),
            f"{_share(row['low'])} to {_share(row['high'])}",
        ]
        for row in rows
    ]
    return _table(["score of a grasp (rgb)", "executed", "stated", "held", "95 % interval (Wilson)"], lines)


def _summary_table(document: dict) -> str:
    numbers = {k: v for k, v in document["summary"].items() if isinstance(v, int | float | str)}
    return _table(["measure", "value"], [[key, _number(value)] for key, value in numbers.items()])


def _soak_table(document: dict) -> str:
    """One line for each kind of long run."""
    lines = []
    for kind in dict.fromkeys(row["kind"] for row in document["rows"]):
        rows = [row for row in document["rows"] if row["kind"] == kind]
        of = ", ".join(row["subject"] for row in rows) if len(rows) <= 12 else f"{len(rows)} kinds"
        sums = (sum(row[name] for row in rows) for name in ("tried", "failed", "lost"))
        lines.append([kind, of, *(f"{count:,}" for count in sums)])
    return _table(["tested", "of", "tried", "failed", "lost"], lines)


def _readme_table(documents: Sequence[tuple[str, dict]]) -> str:
    """What a user gets: the best-ranked grasp, in every document that executed grasps."""
    lines = []
    for name, document in documents:
        summary = document["summary"]
        if document["benchmark"] == "grasp":
            cells = [_share(summary.get(f"top1_{one}")) for one in ("gt", "rgb", "similarity", "rigid")]
            views = sum(row["views"] for row in document["rows"] if row["estimator"] == "rgb")
        elif document["benchmark"] == "photos":
            executed = [row for row in document["rows"] if "grasp_held" in row.get("rgb", {})]
            shares = [
                _mean(row[one]["grasp_held"] for row in executed if "grasp_held" in row.get(one, {}))
                for one in ("rgb", "similarity", "rigid")
            ]
            cells, views = ["", *(_share(share) for share in shares)], len(executed)
        else:
            continue
        if views:
            lines.append([name.replace("-", " "), str(views), *cells])
    heads = ["best-ranked grasp, held", "views", "true field", "**rgb**", "similarity", "rigid"]
    return _table(heads, lines)


def _mean(values) -> float | None:
    values = [float(value) for value in values]
    return sum(values) / len(values) if values else None


def _number(value: float | str | None) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def _share(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.0f} %"


TABLES: dict[str, Callable[[dict], str]] = {
    "registration": _registration_table,
    "pose-noise": _registration_table,
    "glass": _summary_table,
    "grasp": _grasp_table,
    "photos": _photo_table,
    "calibration": _summary_table,
    "refusal": _summary_table,
    "latency": _summary_table,
    "engines": _summary_table,
    "cpd": _summary_table,
    "latent-fit": _summary_table,
    "soak": _soak_table,
}


def write_figures(settings: FigureSettings) -> None:
    """Take new documents in, and write the page and the README's table."""
    keep_documents(settings.keep)
    documents = read_documents()
    write_whole(settings.root / PAGE, figures_page(documents).encode())
    readme = settings.root / README
    write_whole(readme, with_figures(readme.read_text(), documents).encode())


if __name__ == "__main__":
    write_figures(tyro.cli(FigureSettings))
