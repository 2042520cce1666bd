# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# For the scripts beside this one, which source it in the repository's root: `ensure_venv [EXTRA]`
# makes .venv hold this checkout with its dependencies. If it already does, nothing is installed.

die() {
    echo "error: $*" >&2
    exit 2
}

# Runs a command, shows its output only if it fails.
quietly() {
    local output
    output=$("$@" 2>&1) || die "this command failed: $*"$'\n'"$output"
}

# Prints the version (X.Y) of the interpreter $1 if it runs and the project supports it.
supported_version() {
    "$1" -c 'import sys
version = sys.version_info[:2]
if not (3, 10) <= version < (3, 14): sys.exit(1)
print("%d.%d" % version)' 2>/dev/null
}

# Prints the interpreter to build .venv with: $PYTHON, or else the first suitable one.
find_python() {
    local candidates=(python3 python3.13 python3.12 python3.11 python3.10) candidate version
    local problem="no Python >= 3.10 and < 3.14 found; install one, or set PYTHON to its path"
    if [[ -n ${PYTHON:-} ]]; then
        candidates=("$PYTHON")
        problem="PYTHON=$PYTHON is not a Python >= 3.10 and < 3.14"
    fi
    for candidate in "${candidates[@]}"; do
        version=$(supported_version "$candidate") || continue
        if "$candidate" -c 'import ensurepip, venv' 2>/dev/null; then
            echo "$candidate"
            return
        fi
        problem="$candidate lacks the venv module; install it (Debian, Ubuntu: apt install python$version-venv)"
    done
    die "$problem"
}

ensure_venv() {
    local extra=${1:+[$1]} stamp=.venv/ruledgraph-installed python version wanted
    version=$(supported_version .venv/bin/python) || version=
    if [[ -z $version || -n ${PYTHON:-} ]]; then
        python=$(find_python)
        if [[ $(supported_version "$python") != "$version" ]]; then
            version=$(supported_version "$python")
            echo "Creating .venv with Python $version"
            quietly "$python" -m venv --clear .venv
        fi
    fi
    # All that decides what is installed: the projects' data, the sources of the native kernels and
    # the names of the modules, which an editable install maps one by one.
    wanted=$(
        cat pyproject.toml factors/pyproject.toml tools/_factors_requirement.py
        find factors/{CMakeLists.txt,cmake,include,src} ruledgraph/frontend/native -type f |
            LC_ALL=C sort | xargs cat
        find ruledgraph factors -name '*.py' | LC_ALL=C sort
    )
    wanted=$(cksum <<<"$wanted")
    wanted="Python $version, $PWD, sources $wanted"
    if [[ -f $stamp && $(<"$stamp") == "$wanted"*"$extra" ]]; then
        return
    fi
    echo "Installing ruledgraph$extra and its dependencies into .venv; this can take minutes"
    rm -f "$stamp"
    # A venv whose creation was interrupted, or whose Python was upgraded, has no pip.
    .venv/bin/python -m pip --version >/dev/null 2>&1 || quietly .venv/bin/python -m ensurepip
    # Where both were one distribution, removing the old one afterwards would take the new files.
    quietly .venv/bin/python -m pip --disable-pip-version-check uninstall --yes \
        ruledgraph ruledgraph-factors
    RULEDGRAPH_FACTORS=linked quietly .venv/bin/python -m pip --disable-pip-version-check \
        install --editable ./factors --editable ".$extra"
    echo "$wanted $extra" >"$stamp"
    echo "Installed $(.venv/bin/ruledgraph --version)"
}
