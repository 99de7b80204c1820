#!/bin/sh
# Looks for what Debian must provide and installs it as root, or prints the one line that does.
# usage: debian_packages.sh demo|test|fuzz PYTHON
set -eu
purpose=$1
python=$2
missing=""
need() { # need PACKAGES... unless the last command succeeded
    missing="$missing $*"
}

command -v g++ >/dev/null || need g++
command -v "$python" >/dev/null || need python3
if command -v "$python" >/dev/null; then
    "$python" -c 'import ensurepip, venv' 2>/dev/null || need python3-venv
    "$python" -c 'import sys, sysconfig, pathlib; sys.exit(not pathlib.Path(sysconfig.get_path("include"), "Python.h").exists())' || need python3-dev
else
    need python3-venv python3-dev
fi
if [ "$purpose" = test ]; then
    command -v pkg-config >/dev/null || need pkg-config
    pkg-config --exists gobject-introspection-1.0 2>/dev/null || need libgirepository1.0-dev
    pkg-config --exists cairo 2>/dev/null || need libcairo2-dev
    ls /usr/lib/*/girepository-1.0/Aravis-0.8.typelib >/dev/null 2>&1 || need gir1.2-aravis-0.8
    command -v arv-fake-gv-camera-0.8 >/dev/null || need aravis-tools
    command -v arv-tool-0.8 >/dev/null || need aravis-tools-cli
    command -v gpsfake >/dev/null || need gpsd gpsd-tools gpsd-clients
    command -v systemd-analyze >/dev/null || need systemd
    [ -e /usr/include/simde/x86/avx512.h ] || need libsimde-dev
fi
if [ "$purpose" = fuzz ]; then
    command -v clang++ >/dev/null || need clang
    ls "$(clang++ -print-resource-dir 2>/dev/null)"/lib/linux/libclang_rt.fuzzer-*.a >/dev/null 2>&1 || need libclang-rt-dev
fi

[ -n "$missing" ] || exit 0
if [ "$(id -u)" = 0 ]; then
    echo "installing from Debian:$missing" >&2
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -q >&2
    # shellcheck disable=SC2086
    apt-get install -y -q --no-install-recommends $missing >&2
else
    echo "first, as root: apt install$missing" >&2
    exit 1
fi
