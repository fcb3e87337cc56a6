"""Controllers: state estimates and references to commands."""
