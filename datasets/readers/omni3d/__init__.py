"""Cuboids in Omni3D's JSON: what a file may hold, and its reader."""
