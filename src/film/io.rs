//! Files: EXR in and out, PNG out after the tone map.
