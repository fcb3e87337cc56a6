"""Hull control: station keeping, thrust allocation, thrust margin."""
