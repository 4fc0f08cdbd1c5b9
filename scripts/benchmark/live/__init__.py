"""Parts of the benchmark that run controller, plant and panel as processes in real time."""
