"""Tasks of dm_control: speed, scores, and a policy that learns."""
