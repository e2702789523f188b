"""`make audit`: what is known of the installed packages, and what could not be asked."""

import io
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import distribution
from pathlib import Path
from runpy import run_path

import pytest
from rich.console import Console

AUDIT = run_path(str(Path(__file__).parent.parent / ".ci" / "audit.py"))


class _Package:
    """An installed package as `importlib.metadata` shows it."""

    def __init__(self, name: str, version: str, **metadata: str):
        self.version = version
        self.files = []
        self.metadata = _Metadata({"Name": name, **metadata})


class _Metadata(dict):
    def __missing__(self, key):
        return None

    def get_all(self, key, default):
        return default


@pytest.fixture
def registry():
    """A registry on this machine; its answers by path."""
    answers: dict[str, dict] = {}

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            answer = answers.get(self.path)
            self.send_response(200 if answer is not None else 404)
            self.end_headers()
            self.wfile.write(json.dumps(answer).encode())

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    yield answers, f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def _file(name: str, *, yanked: bool | str = False) -> dict:
    return {"filename": name, "upload-time": "2026-02-03T00:00:00Z", "yanked": yanked}


def test_a_known_fault_and_a_withdrawn_release_are_shown_and_fail(registry):
    answers, address = registry
    files = [_file("two_words-1.0-py3-none-any.whl", yanked="wrong sums"), _file("two_words-1.2.tar.gz")]
    answers["/simple/two-words/"] = {"files": [*files, _file("two_words-2.0rc1.tar.gz")]}
    answers["/pypi/Two_Words/1.0/json"] = {"vulnerabilities": [{"id": "CVE-1", "fixed_in": ["1.2"]}]}
    found = AUDIT["examine"](_Package("Two_Words", "1.0", License="MIT"), address)
    assert found.newest == "1.2 2026-02-03"
    assert found.faults == ("withdrawn: wrong sums", "CVE-1 (fixed in 1.2)")
    assert AUDIT["report"]([found], Console(quiet=True)) == 1


def test_a_package_without_faults_passes(registry):
    answers, address = registry
    answers["/simple/one/"] = {"files": [_file("one-1.0-py3-none-any.whl")]}
    answers["/pypi/one/1.0/json"] = {"vulnerabilities": []}
    found = AUDIT["examine"](_Package("one", "1.0", License="MIT"), address)
    assert found.faults == ()
    assert AUDIT["report"]([found], Console(quiet=True)) == 0


def test_a_registry_that_does_not_answer_is_never_taken_for_no_faults(registry):
    answers, address = registry
    answers["/simple/one/"] = {"files": [_file("one-1.0-py3-none-any.whl")]}
    found = AUDIT["examine"](_Package("one", "1.0", License="MIT"), address)
    console = Console(record=True, width=160, file=io.StringIO())
    assert AUDIT["report"]([found], console) == 3
    assert "did not answer every question about 1 of 1 packages" in console.export_text()


@pytest.mark.parametrize("licence", ["", "GPL-3.0-only", "GNU General Public License v3"])
def test_a_missing_or_binding_licence_fails(registry, licence):
    answers, address = registry
    answers["/simple/one/"] = {"files": [_file("one-1.0-py3-none-any.whl")]}
    answers["/pypi/one/1.0/json"] = {"vulnerabilities": []}
    found = AUDIT["examine"](_Package("one", "1.0", License=licence), address)
    assert AUDIT["report"]([found], Console(quiet=True)) == 1


def test_the_licences_of_real_packages_are_read():
    assert "BSD" in AUDIT["licence"](distribution("numpy"))
    assert "BSD" in AUDIT["licence"](distribution("embreex"))  # states a whole text
