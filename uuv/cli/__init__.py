"""The command `uuv`: one door to jobs, runs, parts and skeletons of one's own."""
