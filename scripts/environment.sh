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
  for python in "${PYTHON:-}" python3 python3.14 python3.13 python3.12 python3.11 python; do
    if [ -n "$python" ] && "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$python"
      return
    fi
  done
  fail "sonocal needs Python 3.11 or later and found none; install one or set PYTHON to it"
}

# Says what is being done, since when, and how many of the core's parts are compiled, until it is killed.
tell() {
  local begun=$SECONDS part
  while sleep 0.2; do
    part=$(grep -o '^ *\[[0-9]*/[0-9]*\]' "$2" 2>/dev/null | tail -1 | tr -d ' ' || true)
    printf '\r\033[K%s %s %d s' "$1" "$part" $((SECONDS - begun)) >&2
  done
}

# Runs a command with its output in a file, and shows how it goes on; what takes no time is not mentioned.
#
#   step WHAT COMMAND...
step() {
  local what=$1 begun=$SECONDS teller='' status=0
  shift
  : >"$log"
  if [ -t 2 ]; then
    tell "$what" "$log" &
    teller=$!
    trap 'kill "$teller"' EXIT
  fi
  "$@" >"$log" 2>&1 || status=$?
  if [ -n "$teller" ]; then
    trap - EXIT
    kill "$teller" && wait "$teller" 2>/dev/null || true
    printf '\r\033[K' >&2
  fi
  if [ $status != 0 ]; then
    tail -n 40 "$log" >&2
    fail "$what failed; the lines above say why, $log all of it"
  fi
  if [ $((SECONDS - begun)) -ge 2 ]; then echo "$what: $((SECONDS - begun)) s" >&2; fi
}

prepare() {
  require_compiler
  local python log=.venv/install.log pip=".venv/bin/python -m pip --disable-pip-version-check"
  python=$(find_python)
  mkdir -p .venv
  [ -x .venv/bin/python ] || step "1/4 making .venv" "$python" -m venv .venv
  step "2/4 updating pip" $pip install 'pip>=25.1'
  # Python compiles what it imports by itself: the rest of it would take half a minute of a processor.
  step "3/4 fetching what it needs" $pip install --no-compile --group "$1"
  # The core is built in place with the tools of .venv, so that a second run compiles only what changed.
  step "4/4 compiling the core (minutes, once)" $pip install --verbose --no-build-isolation --editable .
  .venv/bin/python -c 'import sonocal' || fail "the installation failed; $log says why"
}
