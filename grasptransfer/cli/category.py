"""`grasptransfer category list | info | check`: list, describe and check categories."""

from rich.console import Console
from rich.table import Table

from grasptransfer.cli.json_output import JsonFlag, print_json
from grasptransfer.options import CategoryArgument

console = Console(markup=False)


def list_(*, as_json: JsonFlag = False) -> int:
    """List the shipped categories."""
    from grasptransfer.category import list_categories, load_category

    if as_json:
        print_json(list(list_categories()))
        return 0
    table = Table("category", "train", "test", "modes", "beta", "grasps")
    for name in list_categories():
        category = load_category(name)
        settings = category.settings
        row = (len(category.train), len(category.test), settings.modes, f"{settings.beta:g}")
        table.add_row(name, *(str(value) for value in row), "yes" if category.grasps_path.is_file() else "no")
    console.print(table)
    return 0


def info(category: CategoryArgument, *, as_json: JsonFlag = False) -> int:
    """Describe a category: its settings, its split and its measured figures."""
    from grasptransfer.category import load_category

    loaded = load_category(category)
    if as_json:
        print_json(loaded.file.model_dump(mode="json", exclude={"checksums"}, by_alias=True))
        return 0
    console.print(loaded.file.model_dump(exclude={"checksums"}, by_alias=True))
    return 0


def check(category: CategoryArgument, *, as_json: JsonFlag = False) -> int:
    """Verify a category folder and its grasps, and explain every fault."""
    from grasptransfer.category_check import check_category

    faults = check_category(category)
    if as_json:
        print_json([{"path": str(one.path), "problem": one.problem, "fix": one.fix} for one in faults])
        return 2 if faults else 0
    for fault in faults:
        console.print(f"fault: {fault}", soft_wrap=True)
    console.print("no fault" if not faults else f"{len(faults)} fault{'s' * (len(faults) > 1)}")
    return 2 if faults else 0
