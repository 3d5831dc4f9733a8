"""Other people's formats for cuboids.

Read and written over one statement of what each format means.
"""
