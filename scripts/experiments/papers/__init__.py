"""What the papers state, and what is measured here."""
