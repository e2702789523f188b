"""Files are written whole or not at all."""

import dataclasses

import numpy as np
import pytest

from grasptransfer.data_files import read_array, read_data, read_yaml
from grasptransfer.errors import PoseError, SettingsError
from grasptransfer.files import content_key, replacing, sha256, write_whole


def test_a_file_that_fails_half_way_leaves_the_old_one_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    write_whole(path, b"old")
    with pytest.raises(RuntimeError), replacing(path) as temporary:  # noqa: PT012
        temporary.write_bytes(b"ne")
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_temporary_file_keeps_folder_and_ending(tmp_path):
    with replacing(tmp_path / "a.npz") as temporary:
        assert (temporary.parent, temporary.suffix) == (tmp_path, ".npz")
        assert not (tmp_path / "a.npz").exists()
        temporary.write_bytes(b"new")
    assert (tmp_path / "a.npz").read_bytes() == b"new"


def test_a_new_file_has_the_permissions_of_any_other(tmp_path):
    (tmp_path / "other").touch()
    write_whole(tmp_path / "a", b"")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_missing_folders_are_made_only_for_whole_contents(tmp_path):
    write_whole(tmp_path / "b/c/a", b"content")
    assert (tmp_path / "b/c/a").read_bytes() == b"content"
    with pytest.raises(SettingsError, match="cannot be written"), replacing(tmp_path / "d/a"):
        pass


def test_a_file_in_the_way_of_a_folder_is_named(tmp_path):
    (tmp_path / "b").touch()
    with pytest.raises(SettingsError, match="cannot be written") as caught:
        write_whole(tmp_path / "b/a", b"")
    assert caught.value.path == tmp_path / "b/a"


def test_what_cannot_be_written_is_told_under_its_own_name(tmp_path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(SettingsError) as in_the_way:
        write_whole(tmp_path / "a.txt", b"")
    assert str(in_the_way.value) == f"{tmp_path}/a.txt: cannot be written. Is a directory"
    with pytest.raises(SettingsError) as without_folder, replacing(tmp_path / "b/a.txt"):
        pass
    assert str(without_folder.value) == f"{tmp_path}/b/a.txt: cannot be written. No such file or directory"
    assert list(tmp_path.iterdir()) == [tmp_path / "a.txt"]


def test_equal_bytes_have_equal_checksums(tmp_path):
    for name, content in (("a", b"1"), ("b", b"1"), ("c", b"2")):
        write_whole(tmp_path / name, content)
    assert sha256(tmp_path / "a") == sha256(tmp_path / "b") != sha256(tmp_path / "c")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a: &x {k: 1}\nb: &y\n  <<: *x\n  k: 2\nc: {<<: *y}", {"a": {"k": 1}, "b": {"k": 2}, "c": {"k": 2}}),
        ("1: a\nno: yes\n", {"1": "a", "no": "yes"}),
        ("a: 6.9e2\nb: -5e-1\nc: 010\nd: .5", {"a": 690.0, "b": -0.5, "c": 10, "d": 0.5}),
        ("a: 1:30\nb: 2026-01-01\nc: 1_000", {"a": "1:30", "b": "2026-01-01", "c": "1_000"}),
        ("a: true\nb:\nc: null\nd: '5'", {"a": True, "b": None, "c": None, "d": "5"}),
        ('{\n\t"a": [6.9e2, 1]\n}', {"a": [690.0, 1]}),
        ("{a: 1, b: [2]}", {"a": 1, "b": [2]}),
        ("a: 1\n---\n", {"a": 1}),
        ("\ufeffa: 1", {"a": 1}),
        (
            "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: d\n   data: [ 1., 2.e+00 ]\n",
            {"K": {"rows": 1, "cols": 2, "dt": "d", "data": [1.0, 2.0]}},
        ),
    ],
)
def test_yaml_and_json_mean_what_people_who_write_them_mean(tmp_path, text, value):
    (tmp_path / "a.yaml").write_text(text)
    assert read_data(tmp_path / "a.yaml", error=PoseError) == value


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.yaml", "a: 1\nb: 2\na: 3", "line 3, column 1: key 'a' is given twice"),
        ("a.json", '{"a": {"b": 1, "b": 2}}', "key 'b' is given twice"),
        ("a.json", '{"a": 1,', "not valid JSON"),
        ("a.yaml", "a:\n\tb: 1", "not by tabs"),
        ("a.yaml", "a: 1\n---\nb: 2", "2 documents"),
        ("a.yaml", "? [1, 2]\n: 3", "a key must be text"),
        ("a.yaml", "a: !!python/object/apply:os.getcwd []", "not valid YAML"),
        ("a.yaml", "a: \0", "not a text file"),
        ("none.yaml", None, "does not exist"),
    ],
)
def test_a_file_that_is_neither_is_explained_in_one_line(tmp_path, name, text, says):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(PoseError) as caught:
        read_data(tmp_path / name, error=PoseError)
    assert says in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_rows_of_numbers_are_an_array_and_other_text_is_none(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("# by numpy\n1.5e+00, 2\n\n3 4\n")
    np.testing.assert_array_equal(read_array(path, error=PoseError), [[1.5, 2], [3, 4]])
    path.write_text("a: 1")
    assert read_array(path, error=PoseError) is None
    np.save(tmp_path / "a.npy", np.eye(3))
    np.testing.assert_array_equal(read_array(tmp_path / "a.npy", error=PoseError), np.eye(3))
    np.save(tmp_path / "a.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(PoseError, match="npy"):
        read_array(tmp_path / "a.npy", error=PoseError)


@dataclasses.dataclass
class _Part:
    size: float
    name: str


def test_a_content_key_changes_with_every_part_and_only_then():
    array = np.arange(6.0)
    first = ("a", 1, 2.5, None, array, {"x": [1, 2]}, _Part(1.0, "p"), frozenset({"l", "r"}))
    others = [
        ("b", *first[1:]),
        (*first[:1], 2, *first[2:]),
        (*first[:2], 2.5000001, *first[3:]),
        (*first[:3], 0, *first[4:]),
        (*first[:4], array.reshape(2, 3), *first[5:]),
        (*first[:4], array.astype(np.float32), *first[5:]),
        (*first[:5], {"x": [1], "y": [2]}, *first[6:]),
        (*first[:6], _Part(1.0, "q"), *first[7:]),
        (*first[:7], frozenset({"l"})),
    ]
    keys = [content_key(*parts) for parts in (first, *others)]
    assert len(set(keys)) == len(keys)
    assert content_key(*first[:4], array.copy(), {"x": [1, 2]}, _Part(1.0, "p"), frozenset("rl")) == keys[0]


def test_a_path_counts_with_what_it_holds_and_not_with_where_it_is(tmp_path):
    for name in ("here", "there"):
        (tmp_path / name / "sub").mkdir(parents=True)
        (tmp_path / name / "sub" / "mesh.obj").write_text("v 0 0 0")
    key = content_key(tmp_path / "here")
    assert content_key(tmp_path / "there") == key
    (tmp_path / "there" / "sub" / "mesh.obj").write_text("v 0 0 1")
    changed = content_key(tmp_path / "there")
    (tmp_path / "here" / "sub" / "mesh.obj").rename(tmp_path / "here" / "sub" / "other.obj")
    assert len({key, changed, content_key(tmp_path / "here")}) == 3


def test_yaml_that_would_take_minutes_is_refused_at_once(tmp_path):
    long, loop = tmp_path / "long.yaml", tmp_path / "loop.yaml"
    long.write_text("".join(f"key{number}: 1\n" for number in range(100_000)))
    with pytest.raises(SettingsError, match="lines"):
        read_yaml(long, error=SettingsError)
    loop.write_text("a: &a [1, *a]\n")
    with pytest.raises(SettingsError, match="alias"):
        read_yaml(loop, error=SettingsError)


def test_aliases_that_write_out_to_millions_are_refused(tmp_path):
    levels = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for level in range(1, 9):
        levels += f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 10)}]\n"
    path = tmp_path / "bomb.yaml"
    path.write_text(levels)
    with pytest.raises(SettingsError, match="aliases"):
        read_yaml(path, error=SettingsError)
