"""DeepLabCut, csv and h5."""
