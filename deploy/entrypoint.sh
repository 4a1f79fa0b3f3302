#!/bin/sh
# Puts the image's compiled kernels where numba may write, then becomes spot3d, so that signals reach it.
set -eu
mkdir -p "$NUMBA_CACHE_DIR"
cp -R /opt/spot3d/kernels/. "$NUMBA_CACHE_DIR"
exec spot3d "$@"
