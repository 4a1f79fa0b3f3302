#!/usr/bin/env bash
# Runs a command where `docker` works: with this machine's own Docker Engine, else with one that is set up for it.
#
#   with_engine.sh COMMAND...
#
# An engine of its own needs root, Debian's packages (apt) and PyPI (pip), and no image registry. It is Docker Engine 26
# of Debian 13, with BuildKit, compose, seccomp, cgroups and bridge networks as anywhere. A stand-in, because it cannot
# be pulled, is python:3.11-slim: Debian 12 with Debian's Python 3.11, with this machine's certificates and settings
# of pip. Engine and images (4 GB) stay in SPOT3D_ENGINE, by default /var/tmp/spot3d-engine, and are used again.
#
# It has namespaces of its own, joined to the outside by slirp4netns: no rule, bridge or port of it is seen on this
# machine, and no process is left at the end. It sees of this machine's files the checkout and SPOT3D_ENGINE alone.
set -euo pipefail

docker info >/dev/null 2>&1 && exec "$@"
[ "$(id -u)" = 0 ] || { echo "no Docker Engine answers, and only root can set one up" >&2; exit 1; }

CHECKOUT=$(cd "$(dirname "$0")/../.." && pwd)
HOME_OF_IT=${SPOT3D_ENGINE:-/var/tmp/spot3d-engine}
mkdir -p "$HOME_OF_IT/bin" "$HOME_OF_IT/docker" "$HOME_OF_IT/state"
exec 9>"$HOME_OF_IT/lock"
flock 9  # one engine at a time uses these files

# --- the engine's files ---
if ! { command -v mmdebstrap && command -v slirp4netns; } >/dev/null; then
    apt-get update -qq
    apt-get install -y -qq --no-install-recommends mmdebstrap slirp4netns >/dev/null
fi
MIRROR=$(apt-get indextargets --format '$(SITE)' 'Identifier: Packages' | grep '/debian$' | head -n 1)
if [ ! -e "$HOME_OF_IT/engine.done" ]; then
    echo "setting up an engine in $HOME_OF_IT"
    rm -rf "$HOME_OF_IT/engine"
    packages=docker.io,docker-cli,docker-compose,docker-buildx,iptables,iproute2,ca-certificates
    mmdebstrap --quiet --variant=minbase --include=$packages trixie "$HOME_OF_IT/engine" "deb $MIRROR trixie main"
    touch "$HOME_OF_IT/engine.done"
fi

# --- the engine, in mount and network namespaces of its own, where paths mean what they mean outside ---
cat > "$HOME_OF_IT/state/inner.sh" <<'INNER'
set -eu
mount --make-rprivate /
mount --bind "$1/engine" "$1/engine"
cd "$1/engine"
mkdir -p .old var/lib/docker
mount -t proc proc proc
mount --rbind /sys sys
mount --rbind /dev dev
mount -t tmpfs tmpfs run
mount -t tmpfs tmpfs tmp
for path in "$1" "$2"; do mkdir -p "./$path"; mount --bind "$path" "./$path"; done
mount --bind "$1/docker" var/lib/docker
pivot_root . .old
umount -l /.old
echo 'nameserver 10.0.2.3' > /etc/resolv.conf  # slirp4netns's
ip link set lo up
touch "$1/state/ready"
for _ in $(seq 100); do ip -4 addr show tap0 2>/dev/null | grep -q inet && break; sleep 0.1; done
exec dockerd --storage-driver overlay2 --exec-opt native.cgroupdriver=cgroupfs
INNER
rm -f "$HOME_OF_IT/state/ready"
unshare --mount --net --propagation private bash "$HOME_OF_IT/state/inner.sh" "$HOME_OF_IT" "$CHECKOUT" \
    > "$HOME_OF_IT/state/dockerd.log" 2>&1 < /dev/null 9>&- &
ENGINE=$!
finish() {
    status=$?
    kill "$ENGINE" 2>/dev/null || true
    wait "$ENGINE" 2>/dev/null || true
    kill "${SLIRP:-}" 2>/dev/null || true
    exit "$status"
}
trap finish EXIT
for _ in $(seq 100); do [ -e "$HOME_OF_IT/state/ready" ] && break; sleep 0.1; done
slirp4netns --configure --mtu=1500 --disable-host-loopback "$ENGINE" tap0 \
    > "$HOME_OF_IT/state/slirp.log" 2>&1 < /dev/null 9>&- &
SLIRP=$!

# A `docker` for the command: beside the engine, in the caller's folder, with the caller's environment.
cat > "$HOME_OF_IT/bin/docker" <<DOCKER
#!/bin/sh
exec nsenter -t $ENGINE -m -n -- sh -c 'cd "\$1" && shift && HOME=/root exec /usr/bin/docker "\$@"' sh "\$PWD" "\$@"
DOCKER
chmod +x "$HOME_OF_IT/bin/docker"
export PATH="$HOME_OF_IT/bin:$PATH"
for _ in $(seq 100); do docker info >/dev/null 2>&1 && break; sleep 0.3; done
docker info >/dev/null || { tail "$HOME_OF_IT/state/dockerd.log" >&2; exit 1; }

# --- the stand-in for python:3.11-slim ---
if ! docker image inspect python:3.11-slim >/dev/null 2>&1; then
    pushd "$HOME_OF_IT/state" >/dev/null
    {
        printf '[global]\ncert = /etc/ssl/certs/ca-certificates.crt\n'
        for key in index-url trusted-host; do
            value=$(pip config get "global.$key" 2>/dev/null) && echo "$key = $value"
        done
        true
    } > pip.conf
    cp "$(pip config get global.cert 2>/dev/null || echo /etc/ssl/certs/ca-certificates.crt)" ca-certificates.crt
    mmdebstrap --quiet --variant=minbase --include=python3.11,python3.11-venv,ca-certificates,netbase,tzdata \
        --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
        --dpkgopt='path-exclude=/usr/share/locale/*' \
        --customize-hook='ln -s ../../bin/python3.11 "$1/usr/local/bin/python"' \
        --customize-hook='ln -s ../../bin/python3.11 "$1/usr/local/bin/python3"' \
        --customize-hook='copy-in ca-certificates.crt /etc/ssl/certs' \
        --customize-hook='copy-in pip.conf /etc' \
        --customize-hook='rm -f "$1/etc/apt/sources.list"' \
        bookworm base.tar "deb $MIRROR bookworm main"
    docker import --change 'CMD ["python3"]' --change 'ENV LANG=C.UTF-8' \
        --change 'ENV PATH=/usr/local/bin:/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin' \
        "$HOME_OF_IT/state/base.tar" python:3.11-slim >/dev/null
    rm base.tar
    popd >/dev/null
fi
"$@"
