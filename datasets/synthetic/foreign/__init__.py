"""A world that labelling was not made with: other bodies, keypoint places, masks and views.

`config` has its dials, `bodies` stretches the quadruped beyond its presets and cuts it into another
mesh, `places` moves the keypoints, `masks` draws by a renderer of its own, `animals` puts a body
before a camera.
"""
