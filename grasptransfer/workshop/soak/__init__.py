"""Tests that nobody would write by hand: thousands of damaged files, each read in a watched process.

`python -m grasptransfer.workshop.soak --out FOLDER` runs it for as long as asked and prints a table of what
was tried, what failed and what was lost; started again, it goes on where it stopped. A short run of it is
part of the test suite.

| module | does |
| --- | --- |
| `samples` | a valid file of every format that the package reads, and how it is read |
| `mutations` | a damaged copy of a file, decided by a seed |
| `watch` | reads damaged files in a process of its own, limited in time and memory |
| `run` | the whole, its record and its table |
"""
