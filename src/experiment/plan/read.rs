//! From the text of a plan to a [`Plan`].

use super::table::{Fault, Field, Table, line_of};
use super::{Flags, MethodKind, MethodPlan, Plan, Reading, ReferenceSolution, ScenePlan, Tuning, Verdict, combinations, words};
use crate::experiment::report::curves::Clock;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// Wall seconds after which a run is ended unless the plan says otherwise.
const TIMEOUT: f64 = 600.0;

/// Points at which solutions are compared unless the plan says otherwise.
const POINTS: u32 = 4096;

/// Seeds of the reference solution unless the plan says otherwise: far from those that rows have.
const REFERENCE_SEEDS: [u64; 2] = [1_000_001, 1_000_002];

/// Flags that the experiment itself sets.
const RESERVED: [&str; 22] = [
    "output",
    "report",
    "seed",
    "threads",
    "spp",
    "cpu-time",
    "time",
    "error",
    "size",
    "crop",
    "quiet",
    "verbose",
    "progress",
    "snapshots-cpu",
    "partial-every",
    "allow-path",
    "exposure",
    "tone-map",
    "irradiance",
    "points",
    "list-methods",
    "resume",
];

const PLAN_KEYS: [&str; 13] = [
    "title",
    "clock",
    "threads",
    "seeds",
    "repeats",
    "points",
    "timeout",
    "cpu",
    "spp",
    "scene",
    "method",
    "pass_one",
    "reference_solution",
];
const SCENE_KEYS: [&str; 14] = [
    "name",
    "file",
    "references",
    "mask",
    "emitters",
    "size",
    "defines",
    "allow_paths",
    "cpu",
    "spp",
    "timeout",
    "override",
    "optional",
    "reference_solution",
];

/// Where paths of the plan begin and what stands for its `$NAME`s.
struct Place<'a> {
    folder: &'a Path,
    reading: &'a Reading<'a>,
}

/// Reads a plan that lies in `folder`.
pub fn plan(text: &str, folder: &Path, reading: &Reading<'_>) -> Result<Plan, Fault> {
    let root = DeTable::parse(text).map_err(|error| {
        let line = error.span().map_or(1, |span| line_of(text, span.start));
        Fault::new(line, error.message().to_owned())
    })?;
    let mut root = Table::new(text, "the plan", 1, root.get_ref());
    let place = Place { folder, reading };
    let mut common = Tuning { timeout: Some(TIMEOUT), ..Tuning::default() };
    budgets(&mut root, &mut common)?;
    let title = root.read("title", Field::text)?.unwrap_or_else(|| "Error against run time".to_owned());
    let clock = root.read("clock", clock)?.unwrap_or_default();
    let threads = root.read("threads", |f| f.whole(0))?.unwrap_or(0) as usize;
    let seeds = root.read("seeds", |f| f.one_or_more(|f| f.whole(0)))?.unwrap_or_else(|| vec![0]);
    let repeats = root.read("repeats", Field::count)?.unwrap_or(1);
    let points = root.read("points", Field::count)?.unwrap_or(POINTS);
    let solution = root.read("reference_solution", |f| reference_solution(f, &place))?;

    let mut left_out = Vec::new();
    let mut scenes = Vec::new();
    for field in root.need("scene", |f| f.list(|f| Ok(f.clone())))? {
        let (scene, missing) = scene(&field, &place, &common, solution.as_ref())?;
        match missing {
            Some(why) => left_out.push(format!("scene {}: {why}", scene.name)),
            None => scenes.push(scene),
        }
    }
    let mut methods = Vec::new();
    for (key, what) in [("method", "[[method]]"), ("pass_one", "[[pass_one]]")] {
        for field in root.read(key, |f| f.list(|f| Ok(f.clone())))?.unwrap_or_default() {
            let (method, missing) = method(field.table(what)?, key == "pass_one", &place)?;
            match missing {
                Some(why) => left_out.push(format!("method {}: {why}", method.name)),
                None => methods.push(method),
            }
        }
    }
    root.finish(&PLAN_KEYS)?;
    let plan = Plan {
        title,
        text: text.to_owned(),
        folder: folder.to_owned(),
        threads,
        seeds,
        repeats,
        points,
        clock,
        scenes,
        methods,
        left_out,
    };
    check(&plan)?;
    Ok(plan)
}

/// The name of a clock.
fn clock(field: &Field<'_>) -> Result<String, Fault> {
    let known = Clock::ALL.map(Clock::key);
    field
        .text()
        .ok()
        .filter(|name| known.contains(&name.as_str()))
        .ok_or_else(|| field.expected(&format!("one of {}", known.join(", "))))
}

/// What only the whole plan shows.
fn check(plan: &Plan) -> Result<(), Fault> {
    let known: Vec<&str> = plan.scenes.iter().map(|s| s.name.as_str()).collect();
    let absent = |name: &String| plan.leaves_out(name, "");
    for (i, scene) in known.iter().enumerate() {
        if known[..i].contains(scene) {
            return Err(Fault::new(1, format!("two scenes are named \"{scene}\"")));
        }
    }
    for scene in &plan.scenes {
        let is_method = |name: &str| plan.methods.iter().any(|m| m.name == name) || plan.leaves_out("", name);
        if let Some(name) = scene.overrides.keys().find(|name| !is_method(name)) {
            return Err(Fault::new(1, format!("scene {}: override of \"{name}\", which is no method of the plan", scene.name)));
        }
    }
    for (i, method) in plan.methods.iter().enumerate() {
        if plan.methods[..i].iter().any(|m| m.name == method.name) {
            return Err(Fault::new(method.line, format!("two methods are named \"{}\"", method.name)));
        }
        let named = method.scenes.iter().flatten().chain(&method.except);
        if let Some(name) = named.into_iter().find(|name| !known.contains(&name.as_str()) && !absent(name)) {
            return Err(Fault::new(method.line, format!("method {}: there is no scene \"{name}\"", method.name)));
        }
        for scene in plan.scenes.iter().filter(|s| method.runs_on(&s.name)) {
            let tuning = method.tuning_on(scene);
            let fault =
                |what: &str| Err(Fault::new(method.line, format!("method {} on scene {}: {what}", method.name, scene.name)));
            match method.kind {
                MethodKind::Render if tuning.cpu.is_none() && tuning.spp.is_none() => {
                    return fault("expected a budget, cpu or spp");
                }
                MethodKind::External if tuning.spp.is_none() => {
                    return fault("expected a budget spp: it gives one picture a run");
                }
                MethodKind::PassOne if scene.reference_solution.is_none() => {
                    return fault("expected a [reference_solution] to compare with, of the plan or of the scene");
                }
                _ => {}
            }
        }
    }
    if plan.methods.is_empty() && plan.left_out.is_empty() {
        return Err(Fault::new(1, "the plan has no [[method]] and no [[pass_one]]"));
    }
    Ok(())
}

fn budgets(table: &mut Table<'_>, tuning: &mut Tuning) -> Result<(), Fault> {
    let cpu = table.read("cpu", Field::ascending)?;
    let spp = table.read("spp", |f| f.list(Field::count))?;
    let timeout = table.read("timeout", Field::positive)?;
    // Each kind for itself: a plan has times for this program and samples for commands of others, and a scene may change either.
    tuning.cpu = cpu.or(tuning.cpu.take());
    tuning.spp = spp.or(tuning.spp.take());
    tuning.timeout = timeout.or(tuning.timeout);
    Ok(())
}

/// A scene, and why it is left out if it is.
fn scene(
    field: &Field<'_>,
    place: &Place<'_>,
    common: &Tuning,
    solution: Option<&ReferenceSolution>,
) -> Result<(ScenePlan, Option<String>), Fault> {
    let mut table = field.table("[[scene]]")?;
    let name = table.need("name", name)?;
    let optional = table.read("optional", Field::truth)?.unwrap_or(false);
    let file_as_written = table.need("file", Field::text)?;
    let file = place.path(&file_as_written);
    let mut scene = ScenePlan { name, file_as_written, tuning: common.clone(), ..ScenePlan::default() };
    budgets(&mut table, &mut scene.tuning)?;
    scene.size = table.read("size", size)?;
    scene.defines = table.read("defines", defines)?.unwrap_or_default();
    scene.reference_solution = table.read("reference_solution", |f| reference_solution(f, place))?.or_else(|| solution.cloned());
    if let Some(field) = table.take("override") {
        for field in field.table("[scene.override]")?.rest() {
            let tuning = override_of(&field, place)?;
            scene.overrides.insert(field.key, tuning);
        }
    }
    // A scene that is not there has no references to look for either.
    let file = match file.and_then(|file| if file.exists() { Ok(file) } else { Err(format!("no file {}", file.display())) }) {
        Ok(file) => file,
        Err(why) if optional => return Ok((scene, Some(why))),
        Err(why) => return Err(Fault::new(table.line, format!("scene {}: {why}", scene.name))),
    };
    scene.file = file;
    let existing = |f: &Field<'_>| place.existing(f);
    scene.references = table.read("references", |f| f.list(existing))?.unwrap_or_default();
    if scene.references.len() > 2 {
        return Err(Fault::new(table.line, "references: expected one or two independent pictures"));
    }
    scene.mask = table.read("mask", existing)?;
    scene.emitters = table.read("emitters", existing)?;
    scene.allow_paths = table.read("allow_paths", |f| f.list(existing))?.unwrap_or_default();
    table.finish(&SCENE_KEYS)?;
    Ok((scene, None))
}

/// A method, and why it is left out if it is.
fn method(mut table: Table<'_>, pass_one: bool, place: &Place<'_>) -> Result<(MethodPlan, Option<String>), Fault> {
    let line = table.line;
    let name = table.need("name", name)?;
    let command = if pass_one { None } else { table.read("command", |f| place.defined(f))? };
    let kind = match (pass_one, &command) {
        (true, _) => MethodKind::PassOne,
        (false, Some(_)) => MethodKind::External,
        (false, None) => MethodKind::Render,
    };
    let about = table.read("about", Field::text)?;
    let needs = table.read("needs", |f| place.defined(f))?;
    let names = |f: &Field<'_>| f.one_or_more(Field::text);
    let scenes = table.read("scenes", names)?;
    let except = table.read("except", names)?.unwrap_or_default();
    let mut tuning = Tuning { command: command.clone(), ..Tuning::default() };
    budgets(&mut table, &mut tuning)?;
    if kind == MethodKind::External {
        table.finish(&["name", "command", "about", "needs", "scenes", "except", "cpu", "spp", "timeout"])?;
    } else {
        tuning.flags = flags(table.rest(), kind == MethodKind::PassOne)?;
    }
    let about = about.unwrap_or_else(|| match &command {
        Some(command) => command.clone(),
        None => combinations(&tuning.flags).first().map(|(_, chosen)| words(chosen).join(" ")).unwrap_or_default(),
    });
    let missing = needs.filter(|needs| !(place.reading.succeeds)(needs, place.folder)).map(|needs| format!("`{needs}` fails"));
    let unavailable = place.judge(kind, &tuning.flags, line, &name)?;
    Ok((MethodPlan { name, about, kind, scenes, except, tuning, line }, missing.or(unavailable)))
}

fn override_of(field: &Field<'_>, place: &Place<'_>) -> Result<Tuning, Fault> {
    let mut table = field.table("[scene.override.METHOD]")?;
    let mut tuning = Tuning { command: table.read("command", |f| place.defined(f))?, ..Tuning::default() };
    budgets(&mut table, &mut tuning)?;
    let line = table.line;
    tuning.flags = flags(table.rest(), true)?;
    // Either subcommand may know them; which one runs is for the method to say.
    if place.judge(MethodKind::PassOne, &tuning.flags, line, &field.key).is_err() {
        place.judge(MethodKind::Render, &tuning.flags, line, &field.key)?;
    }
    Ok(tuning)
}

fn reference_solution(field: &Field<'_>, place: &Place<'_>) -> Result<ReferenceSolution, Fault> {
    let mut table = field.table("[reference_solution]")?;
    let seeds = table.read("seeds", |f| f.one_or_more(|f| f.whole(0)))?.unwrap_or_else(|| REFERENCE_SEEDS.to_vec());
    if seeds.len() > 2 || (seeds.len() == 2 && seeds[0] == seeds[1]) {
        return Err(Fault::new(table.line, "seeds: expected one seed or two different ones"));
    }
    let timeout = table.read("timeout", Field::positive)?.unwrap_or(TIMEOUT);
    let line = table.line;
    let flags = flags(table.rest(), false)?;
    place.judge(MethodKind::PassOne, &flags, line, "reference_solution")?;
    Ok(ReferenceSolution { flags, seeds, timeout })
}

/// What is left of a method's table: flags of the program.
fn flags(fields: Vec<Field<'_>>, sweeps: bool) -> Result<Flags, Fault> {
    let mut flags = Flags::new();
    for field in fields {
        let name = field.key.replace('_', "-");
        if RESERVED.contains(&name.as_str()) {
            return Err(Fault::new(field.line, format!("{} is set by the experiment itself", field.key)));
        }
        let values = if sweeps { field.one_or_more(Field::word)? } else { vec![field.word()?] };
        flags.insert(name, values);
    }
    Ok(flags)
}

fn name(field: &Field<'_>) -> Result<String, Fault> {
    let name = field.text()?;
    // Names are folders of pictures too.
    let plain = |c: char| c.is_alphanumeric() || " -_.+()".contains(c);
    if name.chars().all(plain) && !name.starts_with('.') && name.trim() == name {
        Ok(name)
    } else {
        Err(field.expected("a name of letters, digits, spaces and -_.+(), which does not begin with a dot"))
    }
}

fn size(field: &Field<'_>) -> Result<(usize, usize), Fault> {
    match field.list(Field::count)?[..] {
        [width, height] => Ok((width as usize, height as usize)),
        _ => Err(field.expected("width and height in pixels")),
    }
}

fn defines(field: &Field<'_>) -> Result<Vec<(String, String)>, Fault> {
    field.table("defines")?.rest().into_iter().map(|f| Ok((f.key.clone(), f.word()?))).collect()
}

impl Place<'_> {
    /// Puts values in for `$NAME`; longer names first, so that `$ab` is not `$a` and a b. The name left over if one has no value.
    fn expand(&self, text: &str) -> Result<String, String> {
        let mut defines: BTreeMap<(std::cmp::Reverse<usize>, &str), &str> = BTreeMap::new();
        self.reading.defines.iter().for_each(|(name, value)| {
            defines.insert((std::cmp::Reverse(name.len()), name), value);
        });
        let expanded = defines.iter().fold(text.to_owned(), |text, ((_, name), value)| text.replace(&format!("${name}"), value));
        match expanded.split_once('$') {
            None => Ok(expanded),
            Some((_, rest)) => {
                let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                Err(format!("${name} has no value; give one by -D {name}=VALUE"))
            }
        }
    }

    /// A path relative to the plan's folder; a value that a user gave for `$NAME` is relative to the current folder.
    fn path(&self, text: &str) -> Result<PathBuf, String> {
        let expanded = self.expand(text)?;
        if text.starts_with('$') {
            return std::path::absolute(&expanded).map_err(|error| format!("{expanded}: {error}"));
        }
        Ok(self.folder.join(expanded))
    }

    /// A path that must be there.
    fn existing(&self, field: &Field<'_>) -> Result<PathBuf, Fault> {
        let found =
            self.path(&field.text()?).and_then(|p| if p.exists() { Ok(p) } else { Err(format!("no file {}", p.display())) });
        found.map_err(|why| Fault::new(field.line, format!("{}: {why}", field.key)))
    }

    /// A command, whose `$NAME`s without a value are the shell's.
    fn defined(&self, field: &Field<'_>) -> Result<String, Fault> {
        let text = field.text()?;
        Ok(self.expand(&text).unwrap_or(text))
    }

    /// Asks whether the program knows the flags. The reason if it knows them but cannot do it.
    fn judge(&self, kind: MethodKind, flags: &Flags, line: usize, name: &str) -> Result<Option<String>, Fault> {
        let subcommand = match kind {
            MethodKind::Render => "render",
            MethodKind::PassOne => "solve",
            MethodKind::External => return Ok(None),
        };
        for (_, chosen) in combinations(flags) {
            let mut line_typed = vec![subcommand.to_owned(), "scene.xml".to_owned()];
            line_typed.extend(words(&chosen));
            match (self.reading.judge)(&line_typed) {
                Verdict::Known => {}
                Verdict::Unavailable(why) => return Ok(Some(why)),
                Verdict::Wrong(why) => return Err(Fault::new(line, format!("{name}: {why}"))),
            }
        }
        Ok(None)
    }
}
