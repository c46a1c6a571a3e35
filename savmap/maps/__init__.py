"""Files of maps, surveys and runs; search; exports."""
