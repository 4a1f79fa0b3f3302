"""`python -m spot3d`."""

from spot3d.cli.app import main

main()
