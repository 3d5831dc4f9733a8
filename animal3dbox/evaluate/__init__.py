"""The paper's evaluation on a world whose truth is known, and what of it any dataset allows."""
