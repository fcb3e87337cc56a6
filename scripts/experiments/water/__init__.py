"""Water: from geometry, from logs, from pool trials, and REMUS 100."""
