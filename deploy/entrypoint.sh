#!/bin/sh
# Puts the image's compiled kernels where numba may write, then becomes spot3d, so that signals reach it.
# Each image has a folder of its own there: a volume keeps what was compiled for this machine's processor, and never
# what was compiled of other code. A folder that no image has used for a month goes.
set -eu
mine=$NUMBA_CACHE_DIR/$(cat /opt/spot3d/kernels.id)
if [ ! -d "$mine" ]; then
    copy=$(mktemp -d "$NUMBA_CACHE_DIR/.copy.XXXXXX")
    cp -R /opt/spot3d/kernels/. "$copy"
    chmod 1777 "$copy"
    # Another container may have been faster.
    mv -T "$copy" "$mine" 2>/dev/null || rm -rf "$copy"
fi
touch "$mine" 2>/dev/null || true
find "$NUMBA_CACHE_DIR" -mindepth 1 -maxdepth 1 -mtime +30 -exec rm -rf {} + 2>/dev/null || true
NUMBA_CACHE_DIR=$mine exec spot3d "$@"
