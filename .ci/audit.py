"""Prints licence, last release and known faults of every installed package.

Licences are what the packages state of themselves. Releases, withdrawals ("yanked") and known faults come
from the package registry; where the registry does not answer, the table says so, and nothing is taken for
faultless.

Usage: python .ci/audit.py [REGISTRY]
Exit codes: 0 nothing to look at; 1 a licence is missing or binds this project, a release was withdrawn or has
a known fault; 3 the registry did not answer for some package, so that faults may be overlooked.
"""

import json
import re
import sys
import urllib.request
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from http.client import HTTPException
from importlib.metadata import Distribution, distributions

from packaging.version import InvalidVersion, Version
from rich.console import Console
from rich.table import Table

REGISTRY = "https://pypi.org"
SIMPLE = "application/vnd.pypi.simple.v1+json"  # PEP 691
BINDING = re.compile(r"\b(A?GPL|GNU (Affero )?General Public)", re.IGNORECASE)  # not LGPL: used, never copied
SILENT = "no answer"
SENTENCES = {  # by which a licence is known when only its text is there
    "Permission is hereby granted, free of charge": "MIT",
    "Redistribution and use in source and binary forms": "BSD",
    "Apache License": "Apache-2.0",
}


@dataclass(frozen=True)
class Finding:
    """What is known of one installed package; `SILENT` where the registry did not answer."""

    name: str
    version: str
    licence: str
    newest: str  # version and day of the last release
    faults: tuple[str, ...]

    @property
    def is_silent(self) -> bool:
        return SILENT in (self.newest, *self.faults)

    @property
    def is_bad(self) -> bool:
        binds = not self.licence or BINDING.search(self.licence) is not None
        return binds or any(fault != SILENT for fault in self.faults)


def licence(package: Distribution) -> str:
    """The stated licence in one short line, "" if none is stated."""
    stated = package.metadata
    expression = stated.get("License-Expression")
    classifiers = [text.split(" :: ")[-1] for text in stated.get_all("Classifier", []) if "License" in text]
    named = [text for text in classifiers if text != "OSI Approved"]
    text = expression or ", ".join(named) or stated.get("License") or ""
    if not text or "\n" in text:
        text = _licence_of_text(text or _licence_file(package))
    return text if len(text) <= 60 else text[:57] + "..."


def _licence_file(package: Distribution) -> str:
    files = [file for file in package.files or () if re.match(r"(LICEN[CS]E|COPYING)", file.name.upper())]
    return files[0].read_text() if files else ""


def _licence_of_text(text: str) -> str:
    words = " ".join(text.split())
    names = [name for sentence, name in SENTENCES.items() if sentence in words]
    return names[0] if names else words


def examine(package: Distribution, registry: str) -> Finding:
    """One package, asked of the registry."""
    name, version = package.metadata["Name"], package.version
    answer = _asked(f"{registry}/simple/{re.sub(r'[-_.]+', '-', name).lower()}/", SIMPLE)
    newest, withdrawn = (SILENT, [SILENT]) if answer is None else _releases(answer, version)
    details = _asked(f"{registry}/pypi/{name}/{version}/json", "application/json")
    known = [SILENT] if details is None else [_fault(entry) for entry in details.get("vulnerabilities", [])]
    return Finding(name, version, licence(package), newest, tuple(dict.fromkeys([*withdrawn, *known])))


def report(findings: Sequence[Finding], console: Console) -> int:
    """Print the table and one sentence on what is missing from it; the exit code."""
    table = Table("package", "installed", "licence", "last release", "known faults")
    for found in findings:
        style = "red" if found.is_bad else None
        table.add_row(found.name, found.version, found.licence or "none stated", found.newest,
                      "; ".join(found.faults) or "none", style=style)  # fmt: skip
    console.print(table)
    bad, silent = [f.name for f in findings if f.is_bad], [f.name for f in findings if f.is_silent]
    console.print(f"{len(findings)} packages; to look at: {', '.join(bad) or 'none'}", soft_wrap=True)
    if silent:
        console.print(
            f"The registry did not answer every question about {len(silent)} of {len(findings)} packages "
            f'(marked "{SILENT}"): faults of these may be known and are not shown here.',
            soft_wrap=True,
        )
    return 1 if bad else 3 if silent else 0


def _asked(url: str, kind: str) -> dict | None:
    request = urllib.request.Request(url, headers={"Accept": kind})
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:
            return json.load(answer)
    except (OSError, HTTPException, ValueError):
        return None


def _releases(answer: dict, installed: str) -> tuple[str, list[str]]:
    """The last release with its day, and why the installed one was withdrawn."""
    newest: tuple[Version, str] | None = None
    files_of_installed, withdrawn = 0, []
    for file in answer.get("files", []):
        version = _version(file["filename"])
        if version is None:
            continue
        if version == Version(installed):
            files_of_installed += 1
            withdrawn += [file["yanked"]] if file.get("yanked") else []
        elif version.is_prerelease or file.get("yanked"):
            continue
        if newest is None or version >= newest[0]:
            newest = version, file.get("upload-time", "")[:10]
    last = f"{newest[0]} {newest[1]}".strip() if newest else SILENT
    if withdrawn and len(withdrawn) == files_of_installed:
        reason = withdrawn[0] if isinstance(withdrawn[0], str) else "no reason given"
        return last, [f"withdrawn: {reason}"]
    return last, []


def _version(filename: str) -> Version | None:
    """The version in the name of a wheel or source package."""
    stem = re.sub(r"(\.tar\.(gz|bz2)|\.zip|\.whl)$", "", filename)
    text = stem.split("-")[1] if filename.endswith(".whl") else stem.rpartition("-")[2]
    try:
        return Version(text)
    except (InvalidVersion, IndexError):
        return None


def _fault(entry: dict) -> str:
    fixed = ", ".join(entry.get("fixed_in", []))
    return entry["id"] + (f" (fixed in {fixed})" if fixed else "")


def main(arguments: Sequence[str]) -> int:
    """Examine all packages of this environment, this project aside."""
    registry = arguments[0].rstrip("/") if arguments else REGISTRY
    packages = {package.metadata["Name"].lower(): package for package in distributions()}
    packages.pop("grasptransfer", None)
    with ThreadPoolExecutor(4) as pool:
        findings = list(pool.map(lambda name: examine(packages[name], registry), sorted(packages)))
    return report(findings, Console(width=160))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
