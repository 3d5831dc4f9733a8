"""Labels in the tables that ecologists' tools read: Camtrap DP, wildlife-datasets, WBIA."""
