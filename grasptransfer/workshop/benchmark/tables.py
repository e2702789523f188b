"""Rows of a benchmark as a table for the terminal."""

from collections import Counter

from rich.table import Table

from grasptransfer.workshop.benchmark.refusal_table import rates


def rows_table(result: dict) -> Table | None:
    """E of every method, mean and (spread over the views); None where rows hold no such scores."""
    rows = result["rows"]
    if rows and "verdict" in rows[0]:
        return _refusals_table(rows)
    if rows and "stage" in rows[0]:
        return _stages_table(rows)
    if rows and "proposals" in rows[0]:
        return None  # of a list of poses the summary says all
    if rows and "image" in rows[0]:
        return _photos_table(rows)
    if rows and "usable_held" in rows[0]:
        return _grasps_table(rows)
    if rows and "apart" in rows[0]:
        return _engines_table(rows)
    methods = list(dict.fromkeys(name for row in rows for name, value in row.items() if _is_score(value)))
    if not methods:
        return None
    table = Table(title=f"{result['benchmark']}: E [1e-6 m²], mean (std over views)")
    table.add_column("instance", overflow="fold")
    ratios = [key for key in rows[0] if key.startswith("rgb_over_")]
    for name in (*methods, *(key.replace("rgb_over_", "rgb / ") for key in ratios)):
        table.add_column(name, justify="right", overflow="fold")
    for row in rows:
        cells = [_cell(row[name]) if name in row else "" for name in methods]
        cells += [f"{row[key]:.2f}" for key in ratios]
        table.add_row(_name(row), *cells)
    return table


def _name(row: dict) -> str:
    """The shipped instances bear their category's name already."""
    category, name = row["category"], row["instance"]
    return name if name.startswith(category) else f"{category}/{name}"


def _stages_table(rows: list[dict]) -> Table:
    """Milliseconds, a stage a line."""
    table = Table("category", "stage", title="ms")
    for name in ("median", "95 %", "first picture"):
        table.add_column(name, justify="right", overflow="fold")
    for row in rows:
        cells = (f"{row[key]:.1f}" for key in ("median_ms", "p95_ms", "cold_ms"))
        table.add_row(row["category"], row["stage"], *cells)
    return table


def _photos_table(rows: list[dict]) -> Table:
    """E and the outline's overlap, or the size error where no mesh is known; a photograph a line."""
    named = (name for row in rows for name, value in row.items() if isinstance(value, dict))
    methods = list(dict.fromkeys(named))
    table = Table("object", "image", title="E [1e-6 m²] and silhouette IoU, or size error [%]")
    for name in (*methods, "mask IoU"):
        table.add_column(name, justify="right", overflow="fold")
    for row in rows:
        cells = [_photo_cell(row.get(name)) for name in methods]
        iou = row.get("mask_iou")
        cells.append("" if iou is None else f"{iou:.2f}")
        table.add_row(f"{row['category']}/{row['object']}", row["image"].rsplit("/", 1)[-1], *cells)
    return table


def _grasps_table(rows: list[dict]) -> Table:
    """Shares held, a category and estimator a line."""
    names = ("all grasps", "best-ranked", "best-ranked where one is usable", "none usable", "usable, held")
    table = Table("category", "estimator", title="grasps held [%]; none usable: share of the views [%]")
    for name in names:
        table.add_column(name, justify="right", overflow="fold")
    groups: dict[tuple[str, str], list[dict]] = {}
    for row in rows:
        groups.setdefault((row["category"], row["estimator"]), []).append(row)
    for names_of_group, group in groups.items():
        table.add_row(*names_of_group, *_grasp_cells(group))
    return table


def _refusals_table(rows: list[dict]) -> Table:
    """A kind of input a line; what is noticed of a right one is a false alarm."""
    table = Table("shown in a", "input", title="inputs: noticed, with the right cause, with a usable grasp")
    for name in ("tried", "noticed", "cause named", "usable grasp"):
        table.add_column(name, justify="right", overflow="fold")
    for line in rates(rows):
        tried = line["tried"]
        shares = [f"{100 * line[key] / tried:.1f} %" for key in ("noticed", "named", "usable")]
        if line["right"]:
            shares[1] = ""
        name = f"right: {line['input']}" if line["right"] else line["input"]
        table.add_row(line["shown"], name, str(tried), *shares)
    return table


def _engines_table(rows: list[dict]) -> Table:
    """Trials on which the engines agree, a category a line, and how those ended on which they do not."""
    engines = list(rows[0]["held"])
    table = Table("category", "trials", "agree", title=f"{' / '.join(engines)}: verdicts")
    for engine in engines:
        table.add_column(f"held in {engine}", justify="right", overflow="fold")
    table.add_column("where they do not agree", overflow="fold")
    for category in dict.fromkeys(row["category"] for row in rows):
        own = [row for row in rows if row["category"] == category]
        trials = sum(row["trials"] for row in own)
        held = [sum(row["held"][engine] for row in own) for engine in engines]
        apart: Counter[str] = Counter()
        for row in own:
            apart.update(row["apart"])
        agree = f"{100 * sum(row['agree'] for row in own) / max(trials, 1):.1f} %"
        reasons = ", ".join(f"{count} {pair}" for pair, count in apart.most_common())
        table.add_row(category, str(trials), agree, *map(str, held), reasons)
    return table


def _grasp_cells(group: list[dict]) -> list[str]:
    def total(key: str) -> float:
        return sum(row[key] for row in group)

    views, without = total("views"), total("without_usable")
    held = sum(row["success"] * row["grasps"] for row in group)
    best = sum(row["top1"] * row["views"] for row in group)
    pairs = (
        (held, total("grasps")),
        (best, views),
        (best, views - without),
        (without, views),
        (total("usable_held"), total("usable")),
    )
    return [f"{100 * part / whole:.0f}" if whole else "" for part, whole in pairs]


def _photo_cell(score: dict | None) -> str:
    if score is None:
        return ""
    if "E" in score:
        return f"{score['E']:.1f}  {score['silhouette_iou']:.2f}"
    return f"{100 * score['size_error']:.0f} %"


def _is_score(value) -> bool:
    return isinstance(value, dict) and {"mean", "std"} <= value.keys()


def _cell(score: dict) -> str:
    return f"{score['mean']:.1f} ({score['std']:.1f})"
