# Makes .venv with sonocal installed from this checkout; sourced by the scripts beside it.
#
#   prepare GROUP    GROUP: dependency group of pyproject.toml (build, test, dev)

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

fail() {
  echo "$1" >&2
  exit 1
}

require_compiler() {
  for compiler in "${CXX:-}" c++ g++ clang++; do
    if [ -n "$compiler" ] && command -v "$compiler" >/dev/null; then return; fi
  done
  fail "sonocal needs a C++ compiler and found none; install one (Debian: apt install g++; macOS: xcode-select --install) or set CXX"
}

find_python() {
  for python in "${PYTHON:-}" python3 python3.13 python3.12 python3.11 python; do
    if [ -n "$python" ] && "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$python"
      return
    fi
  done
  fail "sonocal needs Python 3.11 or later and found none; install one or set PYTHON to it"
}

prepare() {
  require_compiler
  local python
  python=$(find_python)
  [ -x .venv/bin/python ] || "$python" -m venv .venv
  .venv/bin/python -m pip install --quiet --upgrade 'pip>=25.1' 2>&1 | grep -v '^WARNING' || true
  # The core is built in place with the tools of .venv, so that a second run compiles only what changed.
  .venv/bin/python -m pip install --quiet --group "$1" 2>&1 | grep -v '^WARNING' || true
  .venv/bin/python -m pip install --quiet --no-build-isolation --editable . 2>&1 | grep -v '^WARNING' || true
  .venv/bin/python -c 'import sonocal' || fail "the installation failed; the lines above say why"
}
