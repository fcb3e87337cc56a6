"""Control of the arm: inverse dynamics, joint servo, force loop, compliance."""
