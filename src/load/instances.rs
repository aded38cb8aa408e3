//! `shapegroup` and `instance`: every instance becomes shapes of its own, placed in f64.
//!
//! Their triangles are counted before any of them is made, since a few lines can ask for more than a machine holds. The rules are
//! Mitsuba's: a group is not seen by itself, holds no groups and no emitters, and keeps its own materials.

use super::error::{LoadError, LoadErrorKind, Place};
use super::files::Files;
use super::mitsuba::Loader;
use super::object::{Class, Object};
use super::shapes::{PendingShape, SPHERE_BANDS, uniform_scale};
use crate::geometry::tessellate::{self, Triangles};
use crate::math::{DAffine3, DVec3};
use crate::scene::{ShapeSource, SurfaceSource};
use rayon::prelude::*;
use std::collections::HashMap;

/// What a `<shape>` of the scene stands for.
pub(super) enum Pending {
    Shape(Box<PendingShape>),
    Instance(Instance),
}

/// A group to be placed in the scene.
pub(super) struct Instance {
    id: String,
    place: Place,
    /// Index into [`Groups::members`].
    group: usize,
    to_world: DAffine3,
}

/// Groups that have been read, each once however many instances it has.
#[derive(Default)]
pub(super) struct Groups {
    members: Vec<Vec<PendingShape>>,
    /// Objects are told apart by where they are.
    index_of: HashMap<*const Object, usize>,
}

impl<'a> Loader<'a> {
    /// What a `<shape>` at the scene's own level adds to it: nothing if it is a group.
    pub fn pending(&mut self, shape: &'a Object) -> Result<Option<Pending>, LoadError> {
        Ok(match shape.plugin.as_str() {
            "shapegroup" => {
                self.group(shape)?;
                None
            }
            "instance" => Some(Pending::Instance(self.instance(shape)?)),
            _ => Some(Pending::Shape(Box::new(self.shape(shape)?))),
        })
    }

    fn instance(&mut self, shape: &'a Object) -> Result<Instance, LoadError> {
        let group = shape.child(self.ids, Class::SHAPE)?.ok_or_else(|| shape.lacks("a reference to a shapegroup"))?;
        if group.plugin != "shapegroup" {
            let (expected, found) = ("a shapegroup".to_owned(), group.describe());
            return Err(shape.place.error(LoadErrorKind::Malformed { expected, found }));
        }
        let group = self.group(group)?;
        let to_world = shape.transform("to_world")?;
        shape.finish()?;
        let id = shape.id.clone().unwrap_or_else(|| self.make_id("instance"));
        Ok(Instance { id, place: shape.place.clone(), group, to_world })
    }

    fn group(&mut self, group: &'a Object) -> Result<usize, LoadError> {
        if let Some(index) = self.groups.index_of.get(&std::ptr::from_ref(group)) {
            return Ok(*index);
        }
        let refuse = |shape: &Object, what: String| Err(shape.place.error(LoadErrorKind::Unsupported { what }));
        let mut members = Vec::new();
        for (_, shape) in group.children(self.ids, Class::SHAPE) {
            if matches!(shape.plugin.as_str(), "shapegroup" | "instance") {
                return refuse(shape, format!("{} inside a shapegroup", shape.describe()));
            }
            let member = self.shape(shape)?;
            if member.emits() {
                return refuse(shape, format!("an emitter inside a shapegroup ({})", shape.describe()));
            }
            members.push(member);
        }
        if group.get("to_world").is_some() {
            self.warnings.push(format!("{}: its to_world plays no part; place its instances", group.describe()));
        }
        group.finish()?;
        self.groups.members.push(members);
        let index = self.groups.members.len() - 1;
        self.groups.index_of.insert(group, index);
        Ok(index)
    }
}

/// Reads all mesh files side by side and places the instances: shapes in file order, and where each was written. Of several faults
/// the first in file order is told.
pub(super) fn read_all(
    pending: Vec<Pending>,
    groups: Groups,
    files: &Files,
) -> Result<(Vec<ShapeSource>, Vec<Place>), LoadError> {
    let used: Vec<bool> = (0..groups.members.len())
        .map(|group| pending.iter().any(|p| matches!(p, Pending::Instance(i) if i.group == group)))
        .collect();
    let read = |group: Vec<PendingShape>| group.into_par_iter().map(|s| s.read(files)).collect::<Vec<_>>();
    // Nobody sees a group without an instance.
    let groups = groups.members.into_iter().zip(used).map(|(g, used)| if used { g } else { Vec::new() });
    let groups: Vec<Vec<ShapeSource>> = groups.map(|g| read(g).into_iter().collect()).collect::<Result<_, _>>()?;
    let pending: Vec<_> = pending
        .into_par_iter()
        .map(|p| match p {
            Pending::Shape(shape) => Ok((shape.place.clone(), Ok(shape.read(files)?))),
            Pending::Instance(instance) => Ok((instance.place.clone(), Err(instance))),
        })
        .collect();
    let pending: Vec<(Place, Result<ShapeSource, Instance>)> = pending.into_iter().collect::<Result<_, LoadError>>()?;
    count_triangles(&pending, &groups, files.limits.triangles)?;
    let (mut shapes, mut places) = (Vec::with_capacity(pending.len()), Vec::with_capacity(pending.len()));
    for (place, item) in pending {
        match item {
            Ok(shape) => shapes.push(shape),
            Err(instance) => shapes.extend(groups[instance.group].iter().map(|s| placed(s, &instance))),
        }
        places.resize(shapes.len(), place);
    }
    Ok((shapes, places))
}

/// An error if there are more than `limit` triangles in all, at the shape that goes beyond it.
fn count_triangles(
    pending: &[(Place, Result<ShapeSource, Instance>)],
    groups: &[Vec<ShapeSource>],
    limit: u64,
) -> Result<(), LoadError> {
    // A sphere may have to become triangles under an instance's transform; that many are assumed.
    let of = |s: &ShapeSource| match &s.surface {
        SurfaceSource::Triangles(t) => t.triangles.len() as u64,
        SurfaceSource::Sphere { .. } => u64::from(4 * SPHERE_BANDS * (SPHERE_BANDS - 1)),
    };
    let of_group: Vec<u64> = groups.iter().map(|g| g.iter().map(of).sum()).collect();
    let mut found = 0_u64;
    for (place, item) in pending {
        found = found.saturating_add(match item {
            Ok(ShapeSource { surface: SurfaceSource::Sphere { .. }, .. }) => 0,
            Ok(shape) => of(shape),
            Err(instance) => of_group[instance.group],
        });
        if found > limit {
            let what = "number of triangles, instances included".to_owned();
            return Err(place.error(LoadErrorKind::OverLimit { what, limit, found }));
        }
    }
    Ok(())
}

/// A member of a group where an instance puts it.
fn placed(member: &ShapeSource, instance: &Instance) -> ShapeSource {
    let m = &instance.to_world;
    let surface = match &member.surface {
        SurfaceSource::Triangles(t) => SurfaceSource::Triangles(placed_triangles(t.clone(), m)),
        SurfaceSource::Sphere { center, radius } => match uniform_scale(m) {
            Some(scale) => SurfaceSource::Sphere { center: m.transform_point3(*center), radius: radius * scale },
            None => {
                let ball = *m * DAffine3::from_translation(*center) * DAffine3::from_scale(DVec3::splat(*radius));
                SurfaceSource::Triangles(tessellate::sphere(&ball, SPHERE_BANDS))
            }
        },
    };
    let id = format!("{}/{}", instance.id, member.id);
    ShapeSource { id, surface, material: member.material, emission: member.emission.clone() }
}

fn placed_triangles(mut shape: Triangles, m: &DAffine3) -> Triangles {
    shape.positions.iter_mut().for_each(|p| *p = m.transform_point3(*p));
    // Normals go by the inverse transpose, which keeps their side; so must the winding under a mirroring.
    let normal_to_world = m.matrix3.inverse().transpose();
    shape.normals.iter_mut().for_each(|n| *n = (normal_to_world * n.as_dvec3()).normalize_or_zero().as_vec3());
    if m.matrix3.determinant() < 0.0 {
        shape.flip();
    }
    shape
}
