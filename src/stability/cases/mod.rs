//! Catalogue B, one function a case.

mod bodies;
mod energy;
mod limits;
mod placement;
mod surfaces;

use super::Case;

/// All cases in order.
pub(super) const ALL: &[Case] = &[
    ("B1", energy::bright_rooms),
    ("B2", energy::white_rooms),
    ("B3", energy::impossible_reflectances),
    ("B4", energy::tiny_emitter),
    ("B5", energy::bright_beside_dark),
    ("B6", surfaces::slivers),
    ("B7", surfaces::without_area),
    ("B8", surfaces::duplicates),
    ("B9", surfaces::touching_patches),
    ("B10", placement::far_away),
    ("B11", placement::small_and_large),
    ("B12", surfaces::junctions_and_gaps),
    ("B13", energy::open_room),
    ("B14", bodies::inverted_normals),
    ("B15", bodies::camera_in_the_way),
    ("B16", bodies::nothing_to_see),
    ("B17", bodies::mirrors_only),
    ("B18", bodies::nested_glass),
    ("B19", bodies::light_trap),
    ("B20", limits::few_and_many_patches),
    ("B21", limits::not_a_number),
    ("B22", placement::grazing_light),
    ("B23", limits::refinement),
    ("B24", limits::threads),
];
