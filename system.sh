#!/bin/sh
# Installs the few system packages that no wheel brings, where they are missing:
#   run   the X11 and OpenGL libraries that the gmsh wheel links against (no display is needed), and venv
#   test  CalculiX, with which the tests solve the decks that scan2fea wrote
# Debian and Ubuntu only; elsewhere it says what is missing and goes on.
set -u
need=""
have() { ldconfig -p 2>/dev/null | grep -q "$1"; }
case "${1:-run}" in
run)
    have libGLU.so.1 || need="$need libglu1-mesa"
    have libGL.so.1 || need="$need libgl1"
    have libXrender.so.1 || need="$need libxrender1"
    have libXcursor.so.1 || need="$need libxcursor1"
    have libXft.so.2 || need="$need libxft2"
    have libXinerama.so.1 || need="$need libxinerama1"
    have libXfixes.so.3 || need="$need libxfixes3"
    have libgomp.so.1 || need="$need libgomp1"
    "${PYTHON:-python3}" -c "import ensurepip" 2>/dev/null || need="$need python3-venv"
    ;;
test)
    command -v ccx >/dev/null 2>&1 || need="$need calculix-ccx"
    ;;
*)
    echo "usage: system.sh run|test" >&2
    exit 2
    ;;
esac
[ -z "$need" ] && exit 0
if ! command -v apt-get >/dev/null 2>&1; then
    echo "system.sh: please install by your own package manager:$need" >&2
    exit 0
fi
sudo=""
[ "$(id -u)" = 0 ] || sudo=sudo
echo "installing$need"
$sudo apt-get update -qq && $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $need >/dev/null || {
    echo "system.sh: could not install$need; install them by hand, then run make again" >&2
    exit 1
}
