"""Other people's formats for cuboids: read and written over one statement of what each format means."""
