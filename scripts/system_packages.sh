#!/bin/sh
# Installs what the system lacks and a target of the Makefile needs:
#     sh scripts/system_packages.sh python egl chromium
# Where nobody may install without a question, it ends with 1 and one sentence that says what to install. With CHECK=1 it
# installs nothing, and only looks.
#
# python    an interpreter that makes virtual environments (PYTHON names it)
# git       the repository's history, which some tests ask for
# egl       OpenGL without a display, for the camera's pictures
# chromium  the browser of the tests of the live lab and the site, and what Playwright needs to lead it
set -u
export DEBIAN_FRONTEND=noninteractive

has() { command -v "$1" >/dev/null 2>&1; }

debian_has() { [ "$(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]; }

# Where `playwright install chromium` puts a browser, on Linux and on macOS.
playwright_has_one() {
    for folder in "${PLAYWRIGHT_BROWSERS_PATH:-}" ~/.cache/ms-playwright ~/Library/Caches/ms-playwright; do
        ls -d "$folder"/chromium*-* >/dev/null 2>&1 && return 0
    done
    return 1
}

# The packages of Debian and Ubuntu that bring a thing which is not there yet.
lacking() {
    case $1 in
    python)
        python=${PYTHON:-python3}
        "$python" -c 'import ensurepip' 2>/dev/null || echo python3 "$(basename "$python")-venv"
        ;;
    git)
        has git || echo git
        ;;
    egl)
        # macOS and Windows draw by themselves, and a graphics card's driver may bring what is Mesa's part elsewhere.
        [ "$(uname)" = Linux ] || return 0
        if has dpkg-query; then
            debian_has libegl1 || echo libegl1
            debian_has libopengl0 || debian_has libgl1 || echo libopengl0
            ls /usr/share/glvnd/egl_vendor.d/*nvidia* >/dev/null 2>&1 || debian_has libgl1-mesa-dri ||
                echo libgl1-mesa-dri
        else
            ldconfig -p 2>/dev/null | grep -q 'libEGL\.so\.1' || echo libegl1 libopengl0 libgl1-mesa-dri
        fi
        ;;
    chromium)
        # Playwright, which leads the browser, runs on a Node.js that asks for this library of C.
        has dpkg-query && { debian_has libatomic1 || echo libatomic1; }
        has chromium || has chromium-browser || has google-chrome || playwright_has_one || echo chromium
        ;;
    *)
        echo "system_packages.sh: no such thing: $1" >&2
        exit 2
        ;;
    esac
}

look() {
    found=
    for thing in "$@"; do
        found="$found $(lacking "$thing" | tr '\n' ' ')"
    done
    echo $found
}

# What runs apt-get: nothing for root, else sudo where it asks for no password.
may_install() {
    has apt-get || return 1
    [ "$(id -u)" = 0 ] && as_root= && return 0
    has sudo && sudo -n true 2>/dev/null && as_root=sudo
}

missing=$(look "$@")
[ -z "$missing" ] && exit 0

if [ -z "${CHECK:-}" ] && may_install; then
    echo "installing $missing"
    log=$(mktemp)
    $as_root apt-get update --quiet --quiet >"$log" 2>&1
    for package in $missing; do # one at a time: a name that this system does not know must not keep the others out
        $as_root apt-get install --quiet --quiet --yes --no-install-recommends "$package" >>"$log" 2>&1 ||
            tail -n 3 "$log"
    done
    rm "$log"
    missing=$(look "$@")
    [ -z "$missing" ] && exit 0
fi
echo "This machine lacks $missing: install by \`sudo apt-get install $missing\`, or what your system calls them."
exit 1
