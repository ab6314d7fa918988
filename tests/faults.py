#!/usr/bin/env python3
"""Plants the faults of tests/faults.txt one by one, and checks that the tests notice each.

    tests/faults.py WORK [WORD…]
    tests/faults.py --check

WORK: a directory for a copy of the source and its build; it is made if it does not exist (needs about 4 GiB).
WORD: plant only the faults whose promise or file contains one of these.
Prints a line for each fault, and `N passed, N failed` at the end: a fault that no test notices has failed. The exit
status is 0 if there is none. Takes about 20 s for each fault on two cores.

--check plants nothing. It names the faults whose text does not stand in their file, or more than once.
"""

import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM_SECONDS = 600  # a test that hangs has noticed, too


def entries(text):
    """Yields (promise, file, before, after, program, filter) of each fault."""
    for block in text.split("\n\n"):
        lines = [line for line in block.splitlines() if line and not line.startswith("#")]
        if not lines:
            continue
        promise, file = lines[:2]
        part = {"-": [], "+": [], "!": []}
        for line in lines[2:]:
            part[line[0]].append(line[1:])
        program, _, names = part["!"][0].strip().partition(" ")
        yield promise, file, "\n".join(part["-"]), "\n".join(part["+"]), program, names or "*"


def run(*command, **options):
    return subprocess.run(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **options)


def prepare(work):
    """Copies the source and configures a build that compiles fast."""
    source, build = work / "source", work / "build"
    source.mkdir(parents=True, exist_ok=True)
    files = run("git", "-C", ROOT, "ls-files", check=True).stdout.splitlines()
    for name in files:
        there, here = source / name, ROOT / name
        # A file whose text is the same keeps its time, so that nothing is compiled again.
        if not there.exists() or there.read_bytes() != here.read_bytes():
            there.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(here, there)
    if not (build / "build.ninja").exists():
        clang = shutil.which("clang++-19") or sys.exit("faults.py: clang++-19 is missing: docker/install.sh ci")
        done = run("cmake", "-S", source, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Debug", "-DFXAGENT_TESTS=ON",
                   f"-DCMAKE_CXX_COMPILER={clang}", "-DCMAKE_CXX_FLAGS=-O0 -g0 -w",
                   "-DCMAKE_EXE_LINKER_FLAGS=-fuse-ld=lld-19")
        if done.returncode != 0:
            sys.exit(done.stdout)
    return source, build


def build_of(build, program):
    return run("cmake", "--build", build, "--target", program)


def noticed(build, program, names):
    """True if a test of the program fails; returns its output, too."""
    found = next((path for path in build.rglob(program) if path.is_file()), None)
    if found is None:
        sys.exit(f"faults.py: no program {program}")
    try:
        done = run(found, f"--gtest_filter={names}", "--gtest_fail_fast", "--gtest_brief=1", cwd=found.parent,
                   timeout=PROGRAM_SECONDS)
    except subprocess.TimeoutExpired:
        return True, "hung"
    return done.returncode != 0, done.stdout


def main():
    if len(sys.argv) < 2 or (sys.argv[1].startswith("-") and sys.argv[1] != "--check"):
        sys.exit(__doc__)
    every = list(entries((ROOT / "tests/faults.txt").read_text()))
    if sys.argv[1] == "--check":
        stale = [f"{promise} ({file})" for promise, file, before, *_ in every
                 if (ROOT / file).read_text().count(before) != 1]
        print("\n".join(["cannot be planted, its text is not in the file:", *stale]) if stale else "all can be planted")
        return bool(stale)
    source, build = prepare(pathlib.Path(sys.argv[1]).resolve())
    wanted = [entry for entry in every
              if len(sys.argv) == 2 or any(word in entry[0] or word in entry[1] for word in sys.argv[2:])]
    # First without any fault: what fails then shows nothing.
    for program, names in sorted({entry[4:] for entry in wanted}):
        if (done := build_of(build, program)).returncode != 0:
            sys.exit(done.stdout)
        failed, output = noticed(build, program, names)
        if failed:
            sys.exit(f"{program} {names} fails without a fault:\n{output}")
    alive = 0
    for promise, file, before, after, program, names in wanted:
        path = source / file
        text = path.read_text()
        if text.count(before) != 1:
            verdict = f"NOT PLANTED: its text stands {text.count(before)} times in the file"
        else:
            path.write_text(text.replace(before, after))
            done = build_of(build, program)
            if done.returncode != 0:
                verdict = "NOT PLANTED: it does not compile\n" + done.stdout[-2000:]
            else:
                verdict = "noticed" if noticed(build, program, names)[0] else "NOT NOTICED"
            path.write_text(text)
        alive += verdict != "noticed"
        print(f"{verdict}: {promise} ({file})", flush=True)
    print(f"{len(wanted) - alive} passed, {alive} failed")
    return alive != 0


if __name__ == "__main__":
    sys.exit(main())
