"""The bridge over a thin link: joins a robot's router with the ground's, and never makes the robot wait."""
