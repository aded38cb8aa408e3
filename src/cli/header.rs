//! What the EXR file says about how its picture was made.

use twopass::film::io::{Header, Window};
use twopass::math::{DMat4, DVec3};
use twopass::pipeline::Rendered;
use twopass::run_report::RunReport;
use twopass::scene::Camera;

/// The header of a finished or partial picture.
pub fn header(rendered: &Rendered, report: &RunReport) -> Header {
    let frame = &rendered.frame;
    let [x, y, width, height] = frame.crop;
    let scene = rendered.world.scene();
    let window = Window { x, y, full_width: frame.width, full_height: frame.height };
    let (world_to_camera, world_to_ndc) = camera_matrices(&scene.camera, scene.origin, frame.width, frame.height);
    let mut header = Header::default()
        .text("scene", &report.scene)
        .text("sceneHash", &report.scene_hash)
        .text("rendererVersion", &report.version)
        .text("method", &report.method)
        .text("seed", report.seed.to_string())
        .number("samples", report.samples_per_pixel)
        .number("seconds", report.total().wall_s)
        .number("cpuSeconds", report.total().cpu_s)
        .text("complete", report.complete.to_string());
    if let Some(error) = report.estimated_relmse {
        header = header.number("estimatedRelMSE", error);
    }
    header.window = (width != frame.width || height != frame.height).then_some(window);
    header.world_to_camera = Some(row_vectors(world_to_camera));
    header.world_to_ndc = Some(row_vectors(world_to_ndc));
    header
}

/// Column-vector matrices from the scene file's coordinates to OpenEXR's camera space (x right, y up, z forward, left-handed)
/// and to the picture: x and y from -1 (left, bottom) to 1, z from 0 (near clip) to 1 (far clip) after division by w.
fn camera_matrices(camera: &Camera, origin: DVec3, width: usize, height: usize) -> (DMat4, DMat4) {
    let to_world = DMat4::from_translation(origin) * DMat4::from(camera.to_scene);
    // The scene's camera has +x to the left of the picture.
    let world_to_camera = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)) * to_world.inverse();
    let half_width = camera.half_width(width, height);
    let half_height = half_width * height as f64 / width as f64;
    let (near, far) = (camera.near_clip, camera.far_clip);
    let depth = far / (far - near);
    let projection = DMat4::from_cols_array(&[
        1.0 / half_width,
        0.0,
        0.0,
        0.0,
        0.0,
        1.0 / half_height,
        0.0,
        0.0,
        -2.0 * camera.principal_point.x,
        2.0 * camera.principal_point.y,
        depth,
        1.0,
        0.0,
        0.0,
        -near * depth,
        0.0,
    ]);
    (world_to_camera, projection * world_to_camera)
}

/// As OpenEXR stores it: rows of the matrix that multiplies row vectors from the right, which are the columns of this one.
fn row_vectors(matrix: DMat4) -> [f32; 16] {
    matrix.to_cols_array().map(|v| v as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use twopass::math::{DAffine3, DVec2, Vec2};
    use twopass::scene::camera::FovAxis;

    /// A point on the ray through a pixel is found by the matrices at that pixel.
    #[test]
    fn the_matrices_lead_back_to_the_pixel() {
        let (width, height, origin) = (64, 48, DVec3::new(100.0, -20.0, 3.0));
        // A camera at (1, 2, 3) that looks along +x with z up: its +x axis, the picture's left, is then +y.
        let axes = [DVec3::Y, DVec3::Z, DVec3::X, DVec3::new(1.0, 2.0, 3.0)];
        let to_scene = DAffine3::from_cols(axes[0], axes[1], axes[2], axes[3]);
        let principal_point = DVec2::new(0.25, -0.125);
        let camera = Camera {
            to_scene,
            tan_half_fov: 0.4_f64.tan(),
            fov_axis: FovAxis::X,
            principal_point,
            near_clip: 0.1,
            far_clip: 50.0,
        };
        let (to_camera, to_ndc) = camera_matrices(&camera, origin, width, height);
        for pixel in [Vec2::new(0.0, 0.0), Vec2::new(32.0, 24.0), Vec2::new(60.0, 7.0)] {
            let ray = camera.ray(pixel, width, height);
            let point = origin + ray.origin.as_dvec3() + 5.0 * ray.direction.as_dvec3();
            let ndc = to_ndc.project_point3(point);
            let found = ((ndc.x + 1.0) * 0.5 * width as f64, (1.0 - ndc.y) * 0.5 * height as f64);
            assert!((found.0 - f64::from(pixel.x)).abs() < 1e-3, "{pixel}: {found:?}");
            assert!((found.1 - f64::from(pixel.y)).abs() < 1e-3, "{pixel}: {found:?}");
        }
        let ahead = to_camera.transform_point3(origin + DVec3::new(1.0 + 7.0, 2.0, 3.0));
        assert!((ahead - DVec3::new(0.0, 0.0, 7.0)).length() < 1e-12, "{ahead}");
        let right = to_camera.transform_point3(origin + DVec3::new(1.0, 1.0, 3.0));
        assert!((right - DVec3::X).length() < 1e-12, "{right}");
    }
}
