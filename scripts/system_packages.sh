#!/bin/sh
# Installs packages that a bare Debian or Ubuntu lacks, where nobody is asked for a password:
#     sh scripts/system_packages.sh libegl1 libopengl0
# Elsewhere it ends with 1 and the line to type.
set -eu

command -v dpkg-query >/dev/null || exit 0 # another system: what is missing there is said where it is needed
missing=
for package in "$@"; do
    status=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
    [ "$status" = installed ] || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

if [ "$(id -u)" = 0 ]; then
    sudo=
elif sudo -n true 2>/dev/null; then
    sudo=sudo
else
    echo "This machine lacks$missing: sudo apt-get install$missing" >&2
    exit 1
fi
echo "Installing$missing"
export DEBIAN_FRONTEND=noninteractive
$sudo apt-get update -qq
$sudo apt-get install -qq --yes --no-install-recommends $missing >/dev/null
