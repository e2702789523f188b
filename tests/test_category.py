"""Category folders: the shipped ones are sound, and every way to break one is explained."""

import shutil

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from grasptransfer.category import list_categories, load_category, objects_folder
from grasptransfer.category.category import load_scene
from grasptransfer.category.settings import Settings, Split
from grasptransfer.category_check import check_category
from grasptransfer.errors import CategoryError
from grasptransfer.registration import DeformationField, ShapeSpace
from grasptransfer.workshop import objects
from grasptransfer.workshop.building.parametric.canonical_surface import surface_of
from grasptransfer.workshop.building.parametric.library import compact
from grasptransfer.workshop.building.surface_points import visible_surface, voxel_filter, voxel_for
from grasptransfer.workshop.building.writing import CategoryContent, glb_of, write_category
from grasptransfer.workshop.objects.recipe import load_recipe

GLB_ROUNDING = 1e-7  # m: GLB files hold single precision


@pytest.fixture
def boxes(tmp_path, pristine_boxes):
    """A copy of the category of boxes, to be broken."""
    shutil.copytree(pristine_boxes, tmp_path / "box")
    return load_category(tmp_path / "box")


@pytest.fixture(scope="module")
def pristine_boxes(tmp_path_factory):
    """A small category of boxes whose only mode is their height."""
    canonical = trimesh.creation.box((0.06, 0.05, 0.1))
    control = np.asarray(trimesh.sample.sample_surface(canonical, 60, seed=0)[0])
    heights = {f"box_{i}": 0.08 + 0.01 * i for i in range(5)}
    fields, meshes = {}, {}
    for name, height in heights.items():
        stretch = np.array([1, 1, height / 0.1])
        fields[name] = DeformationField.fit(control, control, control * stretch, beta=1.0)
        meshes[name] = trimesh.creation.box(canonical.extents * stretch)
    train = tuple(list(heights)[:4])
    first = fields[train[0]]
    weights = np.stack([fields[name].weights for name in train])
    space = ShapeSpace.fit(weights, control, 1.0, first.centre, first.scale, n_modes=1)
    content = CategoryContent(
        name="box",
        description="Boxes.",
        split=Split(canonical="box_2", train=train, test=("box_4",)),
        settings=Settings(
            beta=1.0, lam=1e-6, modes=1, correspondences="exact", control_points=60, voxel=0.01, samples=4
        ),
        measured={},
        canonical_glb=glb_of(canonical),
        instance_glbs={name: glb_of(mesh) for name, mesh in meshes.items()},
        shape_space=space,
        weights={name: field.weights for name, field in fields.items()},
    )
    return write_category(tmp_path_factory.mktemp("boxes") / "box", content).folder


def test_a_written_category_loads_with_the_same_meshes_and_fields(boxes):
    category = load_category(boxes.folder)
    assert category.name == "box"
    assert category.train == ("box_0", "box_1", "box_2", "box_3")
    assert np.allclose(category.canonical.extents, (0.06, 0.05, 0.1), atol=GLB_ROUNDING)
    assert np.allclose(category.instance_mesh("box_4").extents, (0.06, 0.05, 0.12), atol=GLB_ROUNDING)
    points = category.shape_space.control_points
    # Weights are kept in single precision; of a few units in a kernel sum over 60 points.
    assert np.allclose(category.field("box_4")(points), points * [1, 1, 1.2], atol=1e-5)
    assert np.array_equal(category.training_field(1).weights, category.field("box_1").weights)


def test_a_category_loads_itself(boxes):
    assert load_category(boxes) is boxes


def test_a_sound_category_lacks_only_grasps(boxes):
    assert [fault.path.name for fault in check_category(boxes.folder)] == ["grasps.yaml"]


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(CategoryError) as caught:
        load_category("teapot")
    assert caught.value.choices == list(list_categories())


def test_a_folder_without_category_file_is_named(tmp_path):
    with pytest.raises(CategoryError, match="is missing") as caught:
        load_category(tmp_path)
    assert caught.value.path == tmp_path / "category.yaml"


@pytest.mark.parametrize(
    "relative", ["canonical.glb", "instances/box_1.glb", "shape_space.npz", "fields.npz", "preview.png"]
)
@pytest.mark.parametrize("break_it", ["remove", "truncate"])
def test_a_missing_or_corrupt_file_is_named(boxes, relative, break_it):
    path = boxes.folder / relative
    if break_it == "remove":
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[:-1])
    faults = [fault for fault in check_category(boxes.folder) if fault.path == path]
    assert len(faults) == 1
    assert "missing" in faults[0].problem if break_it == "remove" else "corrupt" in faults[0].problem


def test_loading_a_corrupt_canonical_is_refused(boxes):
    path = boxes.folder / "canonical.glb"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    category = load_category(boxes.folder)
    with pytest.raises(CategoryError, match="corrupt") as caught:
        _ = category.canonical
    assert caught.value.path == path


def test_an_unknown_instance_lists_the_known_ones(boxes):
    with pytest.raises(CategoryError) as caught:
        boxes.instance_mesh("box_9")
    assert caught.value.choices == ["box_0", "box_1", "box_2", "box_3", "box_4"]


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("colour", "red", "not a known key"),
        ("format_version", 7, "must be 1"),
        ("frame", {"length_unit": "mm"}, "'m'"),
        ("split", {"canonical": "a", "train": ["a", "a"]}, "more than once"),
        ("name", "a/b", "pattern"),
    ],
)
def test_a_mistake_in_the_category_file_is_named(boxes, key, value, problem):
    path = boxes.folder / "category.yaml"
    data = yaml.safe_load(path.read_text())
    data[key] = value
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(CategoryError, match=problem) as caught:
        load_category(boxes.folder)
    assert caught.value.path == path
    assert str(caught.value.key).startswith(key)


def test_broken_yaml_is_answered_with_its_line(boxes):
    (boxes.folder / "category.yaml").write_text("name: box\nsplit: [\n")
    with pytest.raises(CategoryError, match="line 3"):
        load_category(boxes.folder)


def test_a_key_given_twice_is_a_fault(boxes):
    boxes.grasps_path.write_text("format: isaac_grasp\nformat: another\n")
    path = boxes.folder / "category.yaml"
    path.write_text(path.read_text() + "name: another\n")
    with pytest.raises(CategoryError, match="'name' is given twice"):
        load_category(boxes.folder)
    (fault,) = check_category(boxes.folder)
    assert (fault.path, "'name' is given twice" in fault.problem) == (path, True)
    (fault,) = check_category(boxes)
    assert (fault.path, "'format' is given twice" in fault.problem) == (boxes.grasps_path, True)


def test_a_shipped_name_comes_before_a_folder_so_called(tmp_path, monkeypatch, capsys):
    from grasptransfer.cli.category import check

    (tmp_path / "mug").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_category("mug").folder == objects_folder() / "mug"
    assert check_category("mug") == []
    assert check("mug") == 0
    (fault,) = check_category("./mug")
    assert "is missing" in fault.problem


def test_settings_that_disagree_with_the_shape_space_are_a_fault(boxes):
    path = boxes.folder / "category.yaml"
    path.write_text(path.read_text().replace("modes: 1", "modes: 3"))
    assert any("settings.modes is 3" in fault.problem for fault in check_category(boxes.folder))


def test_a_stray_instance_and_grasps_of_another_model_are_faults(boxes):
    shutil.copyfile(boxes.folder / "canonical.glb", boxes.folder / "instances/stray.glb")
    boxes.grasps_path.write_text("grasptransfer: {category: box, canonical_sha256: '00'}\n")
    faults = {fault.path.name: fault.problem for fault in check_category(boxes.folder)}
    assert "belongs to no instance" in faults["stray.glb"]
    assert "another canonical model" in faults["grasps.yaml"]


def test_grasps_of_another_category_are_a_fault(boxes):
    boxes.grasps_path.write_text("grasptransfer: {category: mug}\n")
    (fault,) = [fault for fault in check_category(boxes.folder) if fault.path.name == "grasps.yaml"]
    assert "is for category 'mug', not 'box'" in fault.problem


def rewrite(boxes):
    """The same category written once more over itself."""
    names = boxes.train + boxes.test
    content = CategoryContent(
        name="box",
        description="",
        split=boxes.file.split,
        settings=boxes.settings,
        measured={},
        canonical_glb=(boxes.folder / "canonical.glb").read_bytes(),
        instance_glbs={name: (boxes.folder / f"instances/{name}.glb").read_bytes() for name in names},
        shape_space=boxes.shape_space,
        weights={name: boxes.field(name).weights for name in names},
    )
    return write_category(boxes.folder, content)


def test_rewriting_a_category_keeps_grasps_and_other_files(boxes):
    boxes.grasps_path.write_text("grasps: mine\n")
    (boxes.folder / "demo").mkdir()
    (boxes.folder / "demo/picture.jpg").write_bytes(b"picture")
    again = rewrite(boxes)
    assert again.grasps_path.read_text() == "grasps: mine\n"
    assert (again.folder / "demo/picture.jpg").read_bytes() == b"picture"
    assert again.file.checksums == boxes.file.checksums
    assert [path.name for path in boxes.folder.parent.iterdir()] == ["box"]


def test_rewriting_repairs_a_category_whose_file_is_broken(boxes):
    boxes.grasps_path.write_text("grasps: mine\n")
    (boxes.folder / "category.yaml").write_text("name: [")
    (boxes.folder / "preview.png").write_bytes(b"old")
    again = rewrite(boxes)
    assert again.grasps_path.read_text() == "grasps: mine\n"
    assert again.file.checksums == boxes.file.checksums
    assert again.checked_path("preview.png").read_bytes() != b"old"


def test_objects_hold_the_shipped_categories():
    folders = {path.parent.name for path in objects_folder().glob("*/category.yaml")}
    assert set(list_categories()) == folders
    assert "mug" in list_categories()


@pytest.mark.parametrize("name", list_categories())
def test_a_shipped_category_is_sound(name):
    assert check_category(name) == []


@pytest.mark.parametrize("name", list_categories())
def test_a_shipped_category_is_what_its_generator_makes(name):
    category = load_category(name)
    model = objects.canonical(name)
    assert np.allclose(category.canonical.vertices, model.vertices, atol=GLB_ROUNDING)
    assert len(category.train) >= 14
    assert len(category.test) >= 4
    seed = load_recipe(name).test[0]
    instance = category.instance_mesh(f"{name}_{seed:04d}")
    made = objects.sample(name, seed)
    drawn = np.concatenate([part.vertices for part in made.scene().geometry.values()])
    assert np.allclose(instance.bounds, [drawn.min(0), drawn.max(0)], atol=GLB_ROUNDING)


@pytest.mark.parametrize("name", list_categories())
def test_a_shipped_shape_space_explains_shapes_it_never_saw(name):
    category = load_category(name)
    surface = surface_of(objects.canonical(name))
    errors, before = [], []
    for seed in load_recipe(name).test:
        moved = surface.displacements(objects.sample(name, seed))
        latent = category.shape_space.map_estimate(surface.points, moved, 0.001).mean
        found = category.shape_space.field(latent).displacement(surface.points)
        errors.append(np.square(found - moved).sum(1).mean())
        before.append(np.square(moved).sum(1).mean())
    # Its own figure is of random shapes; a handful of test instances spread about it.
    assert 1000 * np.sqrt(np.mean(errors)) < 2 * category.file.measured["heldout_rms_mm"]
    assert np.mean(errors) < 0.05 * np.mean(before)


def test_shipped_objects_stay_small():
    size = sum(path.stat().st_size for path in objects_folder().rglob("*") if path.is_file())
    assert size < 60e6


def test_rays_from_outside_never_see_the_inside():
    inner, outer = trimesh.creation.icosphere(radius=0.03), trimesh.creation.icosphere(radius=0.05)
    points, faces = visible_surface(inner + outer)
    assert (faces >= len(inner.faces)).all()
    # A flat face of a tessellated sphere lies within its radius, by less than 2 %.
    assert np.abs(np.linalg.norm(points, axis=1) - 0.05).max() < 0.02 * 0.05


def test_rays_see_into_a_cup():
    cup = trimesh.creation.annulus(0.03, 0.04, 0.08)
    points, _ = visible_surface(cup)
    assert (np.linalg.norm(points[:, :2], axis=1) < 0.031).mean() > 0.1


def test_the_voxel_filter_leaves_one_of_the_given_points_in_each_voxel():
    points = np.random.default_rng(0).uniform(size=(5000, 3))
    kept = points[voxel_filter(points, 0.1)]
    cells = np.floor((kept - points.min(0)) / 0.1).astype(int)
    assert len(np.unique(cells, axis=0)) == len(kept)
    assert abs(len(points[voxel_filter(points, voxel_for(points, 400))]) - 400) <= 0.02 * 400


def test_large_textures_shrink_and_become_jpeg(tmp_path):
    texture = Image.fromarray(np.random.default_rng(0).integers(0, 255, (1024, 2048, 3), dtype=np.uint8))
    material = PBRMaterial(baseColorTexture=texture)
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.visual = TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    (tmp_path / "box.glb").write_bytes(glb_of(compact(trimesh.Scene(box))))
    (loaded,) = load_scene(tmp_path / "box.glb").geometry.values()
    image = loaded.visual.material.baseColorTexture
    assert (image.size, image.format) == ((512, 256), "JPEG")


def test_checking_from_the_command_line_reads_the_grasps_too(boxes, capsys):
    from grasptransfer.cli.category import check

    boxes.grasps_path.write_text("format: isaac_grasp\nformat_version: 1.0\ngrasps: {}\n")
    assert check(str(boxes.folder)) == 2
    printed = capsys.readouterr().out
    assert "grasps.yaml" in printed
    assert "object_frame: is missing" in printed
    assert "1 fault" in printed
