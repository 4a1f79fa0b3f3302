"""`python -m spot3d`."""

from spot3d.cli import main

main()
