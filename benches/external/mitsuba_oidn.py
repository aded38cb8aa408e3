#!/usr/bin/env python3
"""As mitsuba.py, denoised: its arguments, and the times of rendering the layers and of denoising counted.

Needs `pip install pyoidn` (2.5.1.0 was tried; 88 MB, with its own Open Image Denoise) in the environment of Mitsuba.
"""
import os
import runpy
import sys

sys.argv.append("--denoise")
runpy.run_path(os.path.join(os.path.dirname(os.path.realpath(__file__)), "mitsuba.py"), run_name="__main__")
