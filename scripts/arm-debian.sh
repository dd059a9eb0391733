#!/usr/bin/env bash
# An emulated Debian 12 for ARM, with Python 3.11, in which scripts/check-release.sh tries a wheel.
#
#   scripts/arm-debian.sh make ROOT                       # once; says what it lacks, and fails
#   scripts/arm-debian.sh run ROOT SHARED... -- COMMAND   # sees the folders SHARED by their own names; its mounts end with it
#
# Needs root, debootstrap, qemu-user-static and a kernel with binfmt_misc.
set -euo pipefail
lack() { printf '%s\n' "$*" >&2; exit 1; }

make_root() {
  local root=$1 registered=/proc/sys/fs/binfmt_misc
  [ ! -f "$root.ready" ] || return 0
  [ "$(id -u)" = 0 ] || lack "only root may make an emulated Debian"
  command -v debootstrap >/dev/null || lack "debootstrap is not installed"
  command -v qemu-aarch64-static >/dev/null || lack "qemu-user-static is not installed"
  [ -e "$registered/register" ] || mount -t binfmt_misc none "$registered" 2>/dev/null || true
  [ -e "$registered/qemu-aarch64" ] || update-binfmts --enable qemu-aarch64 2>/dev/null || true
  [ -e "$registered/qemu-aarch64" ] || lack "the kernel runs no programs for ARM (binfmt_misc)"
  rm -rf "$root"
  mkdir -p "$root"
  debootstrap --arch=arm64 --variant=minbase --include=ca-certificates,python3,python3-venv,libgomp1 bookworm "$root" \
    >"$root.log" 2>&1 || lack "debootstrap failed, see $root.log"
  cp -a /usr/local/share/ca-certificates/. "$root/usr/local/share/ca-certificates/" 2>/dev/null || true
  chroot "$root" update-ca-certificates >>"$root.log" 2>&1
  touch "$root.ready"
}

# Becomes the command, so that a signal to this process reaches it.
run() {
  exec unshare --mount sh -ec '
    root=$1
    shift
    mount --rbind /dev "$root/dev"
    mount -t proc proc "$root/proc"
    cp /etc/resolv.conf /etc/hosts "$root/etc/"
    while [ "$1" != -- ]; do
      mkdir -p "$root$1"
      mount --bind "$1" "$root$1"
      shift
    done
    shift
    here=$(pwd)
    exec chroot "$root" sh -c "cd \"\$1\"; shift; exec \"\$@\"" - "$here" "$@"
  ' - "$@"
}

case $1 in
  make) make_root "$2" ;;
  run) shift && run "$@" ;;
esac
