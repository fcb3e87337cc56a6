"""Control of the hull: station keeping, thrust allocation, thrust margin."""
