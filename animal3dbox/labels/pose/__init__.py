"""The camera pose of one animal (section 2.2), a method a file."""
