"""Estimates that control needs: contact force, disturbance of the hull, payload, friction."""
