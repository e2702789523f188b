import numpy as np
import pytest

from grasptransfer.errors import CategoryError, SettingsError
from grasptransfer.workshop import objects

CATEGORIES = objects.generators()
SEEDS = range(12)


@pytest.fixture(scope="module")
def samples():
    return {name: [objects.sample(name, seed) for seed in SEEDS] for name in CATEGORIES}


@pytest.mark.parametrize("name", CATEGORIES)
def test_every_part_is_watertight_and_wound_outwards(name, samples):
    for shape in [objects.canonical(name), *samples[name]]:
        for part in (*shape.parts, *shape.contents):
            solid = part.solid()
            assert solid.is_watertight, part.name
            assert solid.is_winding_consistent, part.name
            assert solid.volume > 0, (part.name, shape.parameters)


@pytest.mark.parametrize("name", CATEGORIES)
def test_bounding_box_is_centred_and_of_hand_size_in_metres(name, samples):
    for shape in [objects.canonical(name), *samples[name]]:
        low, high = shape.mesh().bounds
        np.testing.assert_allclose(low, -high, atol=1e-12)
        assert 0.03 < (high - low).max() < 0.5


@pytest.mark.parametrize("name", CATEGORIES)
def test_topology_is_the_same_for_all_seeds(name, samples):
    canonical = objects.canonical(name)
    for shape in samples[name]:
        np.testing.assert_array_equal(shape.faces, canonical.faces)
        np.testing.assert_array_equal(shape.corresponds, canonical.corresponds)
        assert [part.name for part in shape.parts] == [part.name for part in canonical.parts]
        assert [len(part.vertices) for part in shape.contents] == [
            len(part.vertices) for part in canonical.contents
        ]


@pytest.mark.parametrize("name", CATEGORIES)
def test_canonical_vertices_correspond_exactly(name, samples):
    canonical = objects.canonical(name)
    faces = canonical.faces[::7]
    inside = canonical.vertices[faces].mean(1)
    for shape in samples[name][:3]:
        points, valid = objects.corresponding_points(canonical, shape, inside)
        expected = shape.vertices[faces].mean(1)
        right = (valid == canonical.corresponds[faces].all(1)) & (
            np.linalg.norm(points - expected, axis=1) < 1e-9
        )
        assert right.mean() > 0.98  # where parts touch, the other part's counterpart is as right


@pytest.mark.parametrize("name", CATEGORIES)
def test_canonical_corresponds_to_itself(name):
    canonical = objects.canonical(name)
    points = np.asarray(canonical.mesh().sample(500, seed=1))
    found, _ = objects.corresponding_points(canonical, canonical, points)
    np.testing.assert_allclose(found, points, atol=1e-9)


@pytest.mark.parametrize("name", CATEGORIES)
def test_points_off_the_surface_have_no_counterpart(name):
    canonical = objects.canonical(name)
    _, valid = objects.corresponding_points(canonical, canonical, np.array([[1.0, 0.0, 0.0]]))
    assert not valid.any()


@pytest.mark.parametrize("name", CATEGORIES)
def test_a_seed_gives_the_same_shape_again_and_another_seed_another(name, samples):
    first, again, other = samples[name][0], objects.sample(name, 0), samples[name][1]
    np.testing.assert_array_equal(first.vertices, again.vertices)
    for a, b in zip(first.parts, again.parts, strict=True):
        np.testing.assert_array_equal(a.material.texture, b.material.texture)
    assert first.parameters != other.parameters
    assert np.abs(first.vertices - other.vertices).max() > 1e-3


@pytest.mark.parametrize("name", CATEGORIES)
def test_uv_stay_inside_the_texture_and_normals_have_unit_length(name, samples):
    for shape in samples[name]:
        for part in (*shape.parts, *shape.contents):
            assert part.uv.min() >= -1e-12  # rounding
            assert part.uv.max() <= 1 + 1e-12
            np.testing.assert_allclose(np.linalg.norm(part.normals(), axis=1), 1, atol=1e-9)


@pytest.mark.parametrize("name", CATEGORIES)
def test_vertices_that_are_welded_coincide(name, samples):
    for shape in samples[name]:
        for part in shape.parts:
            np.testing.assert_allclose(part.vertices[part.weld], part.vertices, atol=1e-12)


@pytest.mark.parametrize("name", CATEGORIES)
def test_moving_all_the_way_towards_the_canonical_gives_its_vertices(name, samples):
    canonical = objects.canonical(name)
    moved = samples[name][0].towards(canonical, 1.0)
    np.testing.assert_allclose(moved.vertices, canonical.vertices, atol=1e-15)


@pytest.mark.parametrize("name", CATEGORIES)
def test_the_scene_holds_every_part_and_draws_clear_parts_last(name, samples):
    for shape in samples[name]:
        modes = [mesh.visual.material.alphaMode for mesh in shape.scene().geometry.values()]
        assert len(modes) >= len(shape.parts)
        assert modes == sorted(modes, key=lambda mode: mode == "BLEND")


def test_a_fixed_parameter_is_kept():
    assert objects.sample("mug", 3, height=0.1).parameters["height"] == 0.1


def test_an_unknown_category_or_parameter_is_answered_with_the_choices():
    with pytest.raises(CategoryError, match="mug"):
        objects.sample("teapot", 0)
    with pytest.raises(SettingsError, match="handle_top"):
        objects.sample("mug", 0, colour="red")


def test_a_negative_seed_is_refused():
    with pytest.raises(SettingsError, match="seed: must be 0 or more"):
        objects.sample("mug", -1)


def test_a_mug_is_hollow_and_its_handle_points_forward():
    for seed in SEEDS:
        shape = objects.sample("mug", seed)
        body, handle = shape.parts
        outer = body.solid().convex_hull.volume
        assert body.solid().volume < 0.6 * outer
        assert handle.vertices[:, 0].max() == pytest.approx(shape.vertices[:, 0].max())


def test_liquid_stays_inside_the_bottle():
    for seed in SEEDS:
        shape = objects.sample("bottle", seed)
        # Rays and containment are slow on 6000 faces: every 37th vertex reaches every row of the grid.
        liquid = shape.contents[0].vertices[::37]
        assert shape.parts[0].solid().contains(liquid).all(), shape.parameters


def test_glass_is_blended_and_its_liquid_drawn_before_it():
    shape = next(
        shape
        for shape in (objects.sample("bottle", seed) for seed in range(50))
        if shape.parts[0].material.transparent
    )
    names = list(shape.scene().geometry)
    assert names.index("liquid") < names.index("body")
    material = shape.scene().geometry["body"].visual.material
    assert material.alphaMode == "BLEND"
    assert material.baseColorFactor[3] < 255  # what pyrender takes for transparent


def test_an_opaque_bottle_hides_its_liquid():
    assert "liquid" not in objects.canonical("bottle").scene().geometry


def test_an_empty_glass_mug_draws_nothing_inside():
    glasses = [
        shape
        for shape in (objects.sample("mug", seed, fill=0.02) for seed in range(150))
        if shape.parts[0].material.transparent
    ]
    assert glasses
    for shape in glasses:
        assert "drink" not in shape.scene().geometry
