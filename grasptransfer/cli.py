"""The command line: `grasptransfer …`.

Exit codes: 0 done; 1 ran, and found no usable grasp or missed a bar; 2 wrong input.
"""

import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from rich.logging import RichHandler
from rich.markup import escape
from rich.table import Table

from grasptransfer.benchmark.command_line import COMMANDS as BENCHMARKS
from grasptransfer.errors import GraspTransferError
from grasptransfer.report.progress import progress_bar

Positional = tyro.conf.Positional
console = Console()


def demo(*, out: Path = Path("demo_out"), seed: int = 0) -> int:
    """Transfer grasps to a mug that no training saw, execute them, and write a report.

    Args:
        out: folder for report.html, grasps.yaml and reconstruction.glb.
        seed: of everything random.
    """
    from grasptransfer.report.demo import run_demo

    with progress_bar(console) as progress:
        outcome = run_demo(out, seed=seed, on_stage=lambda text: progress.console.print(f"  {text}"))
    console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def transfer(
    image: Positional[Path],
    *,
    category: str,
    pose: Path,
    out: Path,
    camera: Path | None = None,
    gripper: str = "panda",
    scene: Path | None = None,
    mask: Path | None = None,
    execute: Path | None = None,
    refine_pose: bool = True,
    estimator: str = "rgb",
    depth: Path | None = None,
    device: str = "auto",
    seed: int = 0,
) -> int:
    """Transfer the annotated grasps of a category to the instance in a picture.

    Args:
        image: RGB picture.
        category: name or folder of the category.
        pose: YAML with camera_from_object (4x4, OpenCV, metres), or BOP's cam_R_m2c and cam_t_m2c (mm).
        out: folder for report.html, grasps.yaml and reconstruction.glb.
        camera: YAML with fx fy cx cy width height, or BOP's cam_K; without it 60 degrees are assumed.
        gripper: name, or YAML of your own.
        scene: YAML with obstacles and a support plane.
        mask: picture that is white on the object.
        execute: true mesh of the instance [m], standing at the told pose; PyBullet executes the grasps on it.
        refine_pose: fit the pose together with the shape.
        estimator: rgb, cls, cpd, similarity or rigid.
        depth: 16-bit picture in millimetres, 0 = missing, for the estimators that use depth.
        device: auto, cpu or cuda.
        seed: of everything random.
    """
    from grasptransfer.report.transfer_files import run_transfer

    outcome = run_transfer(
        image,
        pose,
        category,
        camera=camera,
        gripper=gripper,
        scene=scene,
        mask=mask,
        depth=depth,
        execute=execute,
        estimator=estimator,
        refine_pose=refine_pose,
        device=device,
        seed=seed,
        out=out,
    )
    console.print(outcome.sentence, soft_wrap=True)
    return 0 if outcome.usable else 1


def train(
    categories: Positional[tuple[str, ...]] = (),
    *,
    run: Path = Path("runs/default"),
    output: Path | None = None,
    network: str = "compact",
    loss: str = "likelihood",
    samples: int = 20_000,
    steps: int = 4500,
    batch: int = 32,
    echo: int = 1,
    learning_rate: float = 1e-3,
    seed: int = 0,
    device: str = "auto",
    workers: int = 2,
) -> int:
    """Render training pictures and train a network; started again, it goes on where it stopped.

    Args:
        categories: trained together in one network; none given: all shipped ones.
        run: folder of data, checkpoint and log.
        output: weight file; default: objects/models/<categories>.safetensors.
        network: see `grasptransfer.perception.networks`.
        loss: likelihood, or paper (squared offsets times 1000).
        samples: rendered training samples.
        steps: optimiser steps.
        batch: samples a step.
        echo: how often each augmented batch is used; 2 halves what preparing them costs.
        learning_rate: peak of the one-cycle schedule.
        seed: of everything random.
        device: auto, cpu or cuda.
        workers: rendering processes.
    """
    from grasptransfer.category import list_categories, load_category
    from grasptransfer.perception.model_card import default_output, write_card
    from grasptransfer.perception.training import TrainingConfig
    from grasptransfer.perception.training import train as run_training

    names = tuple(load_category(name).name for name in categories or list_categories())
    config = TrainingConfig(
        names,
        network,
        loss,
        samples=samples,
        steps=steps,
        batch=batch,
        echo=echo,
        learning_rate=learning_rate,
        seed=seed,
    )
    output = output or default_output(names)
    with progress_bar(console) as progress:
        rendering = progress.add_task("rendering", total=None)
        training = progress.add_task("training", total=steps)

        def on_step(state):
            terms = "  ".join(f"{name} {value:.3g}" for name, value in state.terms.items())
            text = f"training  {state.samples_per_second:.0f}/s  {terms}"
            progress.update(training, completed=state.step, description=text)

        scores = run_training(
            config,
            run_folder=run,
            output=output,
            device=device,
            workers=workers,
            on_render=lambda done, total: progress.update(rendering, completed=done, total=total),
            on_step=on_step,
        )
    card = write_card(output, config, scores, run)
    console.print(f"Weights: {output}\nModel card: {card}\n{scores}")
    return 0


def annotate(
    category: Positional[str],
    *,
    gripper: str = "panda",
    grasps: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
) -> int:
    """Annotate grasps of a category in the browser.

    Args:
        category: name or folder.
        gripper: name, or YAML of your own.
        grasps: file to edit; the category's own if none is given.
        host: address to serve at; 0.0.0.0 lets other machines in.
        port: to serve at.
    """
    from grasptransfer.annotator import annotate as serve

    serve(category, gripper=gripper, path=grasps, host=host, port=port, on_ready=console.print)
    return 0


def simulate(
    *,
    grasps: Path,
    mesh: Path,
    gripper: str = "panda",
    protocol: str = "lift-shake-v1",
    trials: int = 1,
    workers: int = 1,
    results: Path | None = None,
    seed: int = 0,
) -> int:
    """Execute grasps on a mesh in PyBullet.

    Args:
        grasps: grasp file in any format `convert` reads, object frame.
        mesh: the object, metres.
        gripper: name, or YAML of your own.
        protocol: named and versioned execution protocol.
        trials: perturbed trials of each grasp; 1 executes it exactly.
        workers: processes.
        results: JSON lines that an interrupted run resumes from.
        seed: of the perturbations.
    """
    from grasptransfer.report.execution_table import run_simulation

    table, held = run_simulation(
        grasps, mesh, gripper, protocol=protocol, trials=trials, workers=workers, results=results, seed=seed
    )
    console.print(table)
    return 0 if held else 1


def convert(source: Positional[Path], target: Positional[Path], *, gripper: str = "panda") -> int:
    """Convert a grasp file: isaac_grasp YAML, ACRONYM h5, graspnetAPI npy, GraspGen JSON, by suffix.

    Args:
        source: file to read.
        target: file to write.
        gripper: whose frames the foreign formats mean.
    """
    from grasptransfer.grasping.formats import convert as convert_file

    console.print(f"{convert_file(source, target, gripper=gripper)} grasps: {target}")
    return 0


def frames(gripper: Positional[str] = "panda", *, picture: Path | None = None) -> int:
    """Print the frames of a gripper, and draw them.

    Args:
        gripper: name, or YAML of your own.
        picture: PNG to draw the gripper with its frames to.
    """
    from grasptransfer.grasping import load_gripper
    from grasptransfer.grasping.frames_table import frames_table

    loaded = load_gripper(gripper)
    console.print(frames_table(loaded))
    if picture is not None:
        from grasptransfer.grasping.frames_table import draw_frames

        draw_frames(loaded, picture)
        console.print(f"Picture: {picture}")
    return 0


def category_list() -> int:
    """List the shipped categories."""
    from grasptransfer.category import list_categories, load_category

    table = Table("category", "train", "test", "modes", "beta", "grasps")
    for name in list_categories():
        category = load_category(name)
        settings = category.settings
        row = (len(category.train), len(category.test), settings.modes, f"{settings.beta:g}")
        table.add_row(name, *(str(value) for value in row), "yes" if category.grasps_path.is_file() else "no")
    console.print(table)
    return 0


def category_info(category: Positional[str]) -> int:
    """Describe a category: settings, split, measured figures.

    Args:
        category: name or folder.
    """
    from grasptransfer.category import load_category

    loaded = load_category(category)
    console.print(loaded.file.model_dump(exclude={"checksums"}, by_alias=True))
    return 0


def category_check(category: Positional[Path]) -> int:
    """Verify a category folder and explain every fault.

    Args:
        category: name or folder.
    """
    from grasptransfer.category import check_category, load_category

    faults = check_category(category if category.is_dir() else load_category(str(category)).folder)
    for fault in faults:
        console.print(f"[red]fault[/] {fault}")
    console.print("no fault" if not faults else f"{len(faults)} faults")
    return 2 if faults else 0


def category_build(
    name: Positional[str],
    *,
    meshes: Path,
    canonical: str | None = None,
    test: tuple[str, ...] = (),
    out: Path | None = None,
    front: str = "+x",
    up: str = "+z",
    scale: float = 1.0,
    workers: int = 2,
    overwrite: bool = False,
) -> int:
    """Build a category from your own meshes or point clouds; started again, it resumes.

    Args:
        name: of the category.
        meshes: folder of NAME.obj or NAME/mesh.obj (glb gltf obj ply stl off pcd xyz).
        canonical: instance to take as the canonical model, a name or file; default: the best scored.
        test: instances to keep out of the shape space.
        out: folder to write; default: NAME here.
        front: axis of the files that is the front.
        up: axis of the files that points up.
        scale: metres in one unit of the files.
        workers: processes.
        overwrite: replace an existing folder, keeping its grasps.
    """
    from grasptransfer.category.build import build_category
    from grasptransfer.report.category_page import category_page

    with progress_bar(console) as progress:
        task = progress.add_task("checking", total=None)
        build = build_category(
            name,
            meshes=meshes,
            canonical=Path(canonical).stem if canonical else None,
            test=test,
            out=out,
            front=front,
            up=up,
            scale=scale,
            workers=workers,
            overwrite=overwrite,
            progress=lambda state: progress.update(
                task, description=state.step, completed=state.done, total=state.total
            ),
        )
    page = category_page(build, build.category.folder / "category.html")
    console.print(f"Category: {build.category.folder}\nEvery registration and the modes: {page}")
    return 0


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    handler = RichHandler(console=Console(stderr=True), show_path=False, show_time=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    commands, program = COMMANDS, "grasptransfer"
    if arguments and arguments[0] in GROUPS:
        commands, program = GROUPS[arguments[0]], f"grasptransfer {arguments[0]}"
        arguments = arguments[1:]
    try:
        code = tyro.extras.subcommand_cli_from_dict(commands, prog=program, args=arguments)
    except GraspTransferError as error:
        Console(stderr=True).print("[bold red]error:[/]", escape(str(error)), highlight=False, soft_wrap=True)
        sys.exit(2)
    sys.exit(code)


def _group(name: str) -> Callable[[], int]:
    def show() -> int:
        main([name, "--help"])
        return 0

    show.__doc__ = f"{' | '.join(GROUPS[name])}: see `grasptransfer {name} --help`."
    return show


GROUPS: dict[str, dict[str, Callable[..., Any]]] = {
    "category": {
        "list": category_list,
        "info": category_info,
        "check": category_check,
        "build": category_build,
    },
    "bench": BENCHMARKS,
}
COMMANDS: dict[str, Callable[..., Any]] = {
    "demo": demo,
    "transfer": transfer,
    "category": _group("category"),
    "train": train,
    "annotate": annotate,
    "simulate": simulate,
    "convert": convert,
    "frames": frames,
    "bench": _group("bench"),
}
