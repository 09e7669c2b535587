# Sourced by demo, test and bench: makes .venv in the repository with the package installed in place. Works in the
# bash 3.2 of macOS. After it, PYTHON is the interpreter of the environment and the directory is the repository.

fail() {
    echo "$1" >&2
    exit 1
}

# Says or, as root on Debian with "install" as second argument, does what installs the Debian packages $1.
need_packages() {
    if [ "$2" = install ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
        echo "Installing $1 ..." >&2
        apt-get update -qq >&2 || true
        # shellcheck disable=SC2086  # several packages
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $1 >&2 && return 0
    fi
    if command -v apt-get >/dev/null 2>&1; then
        fail "$3: run 'apt-get install $1' as root, then try again."
    elif [ "$(uname)" = Darwin ]; then
        fail "$3: run 'brew install python@3.12 libsndfile', then try again."
    fi
    fail "$3: install it with your system's package manager, then try again."
}

# Installs the Debian package $1 where that can be done; otherwise one line says what ($2) is left out. Never fails.
want_package() {
    dpkg -s "$1" >/dev/null 2>&1 && return 0
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
        # an old index may name a version that is gone, a container may have none
        if ! apt-cache show "$1" >/dev/null 2>&1; then
            apt-get update -qq >/dev/null 2>&1 || true
        fi
        if apt-cache show "$1" >/dev/null 2>&1; then
            echo "Installing $1 ..." >&2
            DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$1" >/dev/null 2>&1 && return 0
        fi
    fi
    echo "Without the package $1: $2." >&2
}

find_python() {
    local candidate
    for candidate in python3 python3.13 python3.12 python3.11 python3.14; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then
            echo "$candidate"
            return 0
        fi
    done
    return 1
}

# prepare demo|test|bench [install]: "test" and "bench" add the tools that these need, "install" allows system packages.
prepare() {
    local system_python extra stamp wanted allow=${2:-}
    cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1
    PYTHON=$PWD/.venv/bin/python
    extra=""
    [ "$1" = demo ] || extra="[$1]"

    # An environment that does not run (its Python went, or the directory moved) is made anew.
    if [ -e .venv ] && ! "$PYTHON" -m pip --version >/dev/null 2>&1; then
        rm -rf .venv
    fi
    if [ ! -e .venv ]; then
        if ! system_python=$(find_python); then
            need_packages "python3 python3-venv" "$allow" "Python 3.11 or later is missing"
            system_python=$(find_python) || fail "Python 3.11 or later is missing and this system's packages do not have it."
        fi
        if ! "$system_python" -c 'import venv, ensurepip' >/dev/null 2>&1; then
            need_packages "python3-venv" "$allow" "Python's venv module is missing"
        fi
        "$system_python" -m venv .venv || { rm -rf .venv; fail "The Python environment could not be made in $PWD/.venv."; }
    fi

    # The stamp changes with what is to be installed and where the repository lies.
    wanted="$PWD $(cksum <pyproject.toml)"
    for stamp in .venv/installed-*; do
        # any will do for the demo, which needs nothing besides
        [ "$1" = demo ] || [ "$stamp" = ".venv/installed-$1" ] || continue
        [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && return 0
    done
    echo "Installing into $PWD/.venv ..." >&2
    "$PYTHON" -m pip install --quiet --disable-pip-version-check -e ".$extra" \
        || fail "pip could not install the package (see above); is there a network connection?"
    if ! "$PYTHON" -c 'import soundfile' >/dev/null 2>&1; then
        need_packages "libsndfile1" "$allow" "The library libsndfile is missing"
    fi
    echo "$wanted" >".venv/installed-$1"
}
