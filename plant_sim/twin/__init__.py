"""Twin: controller and plant in one process and in lock step; trials, live runs, monitors, recovery."""
