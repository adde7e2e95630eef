#!/usr/bin/env bash
# Install the requirements of the tests besides Python packages: a browser, and EGL with a software renderer.
#
#     tools/system_needs.sh FOLDER
#
# On Debian and Ubuntu the packages come from apt, as root or with sudo. If that is not possible,
# the headless browser of an npm package is unpacked into FOLDER. Ends with 1 if something is still missing.
set -euo pipefail
folder=$1
npm_package=@sparticuz/chromium@147.0.0
npm_sha512=\
e1929e01041af2ea769adebbe6a4a2b73b4b75b42b95ff0129d0b99da79aa7ee4cbf5395d4e94974fa14f84242fe9e6c414254426378afeab9f8485a68e507a5

has_browser() {
    [[ -x $folder/chromium ]] || command -v chromium || command -v chromium-browser || command -v google-chrome
} >/dev/null

has_library() {
    [[ -n $(find /usr/lib /usr/lib64 /usr/local/lib -name "$1*" -print -quit 2>/dev/null) ]]
}

missing() {
    has_browser || echo chromium
    has_library libEGL.so.1 || echo libegl1
    has_library swrast_dri.so || has_library libgallium || echo libgl1-mesa-dri
}

install_by_apt() {
    local as_root=()
    command -v apt-get >/dev/null || return 0
    if ((EUID != 0)); then
        command -v sudo >/dev/null || return 0
        as_root=(sudo)
        [[ -t 0 ]] || as_root=(sudo --non-interactive)
        "${as_root[@]}" true 2>/dev/null || return 0
    fi
    echo "armgate: installing $* by apt"
    "${as_root[@]}" apt-get -qq update || return 0
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get -qq install --yes --no-install-recommends "$@" >/dev/null || return 0
}

install_by_npm() {
    command -v node >/dev/null && command -v npm >/dev/null || return 0
    echo "armgate: unpacking the browser of the npm package $npm_package into $folder"
    rm -rf "$folder" && mkdir -p "$folder"
    unpack & # in a subshell, which ends at the first error
    wait $! || rm -rf "$folder"
}

unpack() {
    cd "$folder"
    npm pack --silent "$npm_package" >package.name
    echo "$npm_sha512  $(<package.name)" | sha512sum --check --quiet
    tar --extract --gzip --file "$(<package.name)" --strip-components 2 package/bin
    for archive in al2023 swiftshader fonts; do
        unbrotli "$archive.tar.br" | tar --extract --no-same-owner
    done
    unbrotli chromium.br >unpacked
    chmod +x unpacked
    rm ./*.br package.name ./*.tgz
    mv unpacked chromium
}

unbrotli() {
    node -e 'process.stdin.pipe(require("zlib").createBrotliDecompress()).pipe(process.stdout)' <"$1"
}

mapfile -t packages < <(missing)
((${#packages[@]} == 0)) || install_by_apt "${packages[@]}"
has_browser || install_by_npm
mapfile -t packages < <(missing)
if ((${#packages[@]})); then
    echo "armgate: the tests need ${packages[*]}, which cannot be installed without root." >&2
    echo "On Debian or Ubuntu: sudo apt-get install ${packages[*]}" >&2
    exit 1
fi
