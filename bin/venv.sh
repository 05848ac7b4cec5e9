# Sourced by bin/demo and bin/test: makes .venv and installs into it when that is needed.

say() { echo "$(basename "$0"): $*" >&2; }

find_python() {
  local candidate
  for candidate in python3.11 python3 python; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
      command -v "$candidate"
      return
    fi
  done
  say "needs Python 3.11 (python3.11 on the PATH): PyBullet has wheels up to CPython 3.11 only."
  return 1
}

# ensure_venv EXTRAS: '' or '[test]'. What has been installed for setup.cfg as it is stays.
ensure_venv() {
  local extras=$1 stamp python
  stamp="$PWD $(cat setup.cfg pyproject.toml | cksum)"
  if .venv/bin/python -c '' 2>/dev/null; then
    grep -qxF "$stamp [test]" .venv/installed 2>/dev/null && return
    [ -z "$extras" ] && grep -qxF "$stamp " .venv/installed 2>/dev/null && return
  else
    python=$(find_python)
    say "making .venv with $python"
    rm -rf .venv
    "$python" -m venv .venv
  fi
  say "installing into .venv (once)"
  rm -f .venv/installed
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --editable ".$extras"
  echo "$stamp $extras" > .venv/installed
}
