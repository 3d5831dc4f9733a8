"""``python -m animal3dbox``."""

from animal3dbox.cli.main import main

main()
