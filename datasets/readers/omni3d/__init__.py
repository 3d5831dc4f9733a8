"""Cuboids in Omni3D's JSON.

`schema` says what a file may hold, `recognition` tells such a file from COCO's, `head` has its
"info"; `elements` checks its elements, `layout` finds the order of its corners,
`dimension_order` that of dimensions without them, `consistency` holds
boxes against the picture, `headings` names their sides, `image_roots` finds its images; `reader`
makes the records.
"""
