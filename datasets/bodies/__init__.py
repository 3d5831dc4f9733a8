"""Where an animal's body comes from: a preset, a mesh file, fitted parameters."""
