"""Files are written whole or not at all."""

import pytest

from grasptransfer.errors import SettingsError
from grasptransfer.files import replacing, sha256, write_whole


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
