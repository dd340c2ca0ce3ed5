//! The long cross-check with Embree: rays by the hundred million.
//!
//! `cargo run --release -p raytwin-tests --example embree_run -- [--rays N]`
//!
//! Random rays through seven meshes, ours and Embree's default side by side.
//! Where the two name one triangle with `t` within 2^-18 of each other, and
//! their occlusion queries agree with that, the ray counts as agreed; every
//! other one is judged against the intersector in double precision, ours and
//! Embree's answers both. Ends with an error if one of ours is wrong.

use std::process::ExitCode;
use std::time::Instant;

use raytwin::ray::bvh_build::BuildQuality;
use raytwin_cpu::ray::ray::Ray;
use raytwin_tests::crosscheck::{
    Answer, Counts, EmbreeEngine, Engine, OursWide, RaySet, Subject, compare,
};
use raytwin_tests::rays::meshes;
use raytwin_tests::scene::{kitchen, toy_room};

const PART: usize = 1 << 18;

/// One engine's answers are in hand already.
struct Given<'a>(&'a (dyn Engine + Sync), Vec<Answer>);

impl Engine for Given<'_> {
    fn name(&self) -> String {
        self.0.name()
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        // `compare` asks the set itself, and single rays beside it.
        if rays.len() == self.1.len() && rays.len() > 1 {
            self.1.clone()
        } else {
            self.0.trace(rays)
        }
    }

    fn takes(&self, ray: Ray, primitive: u32) -> Option<bool> {
        self.0.takes(ray, primitive)
    }

    fn strict(&self) -> bool {
        self.0.strict()
    }
}

fn agree(a: &Answer, b: &Answer) -> bool {
    const NEAR: f32 = 1.0 / 262_144.0;
    let hits = match (a.hit, b.hit) {
        (None, None) => true,
        (Some(x), Some(y)) => x.primitive == y.primitive && (x.t - y.t).abs() <= NEAR * x.t.abs(),
        _ => false,
    };
    hits && a.any == b.any && a.any == a.hit.is_some()
}

fn subjects() -> Result<Vec<Subject>, String> {
    let kitchen = kitchen().map_err(|e| e.to_string())?;
    let toy = toy_room();
    let mut all = vec![
        ("kitchen", kitchen.positions, kitchen.indices),
        ("toy room", toy.positions, toy.indices),
    ];
    let generated = [
        ("displaced sphere, 100k", meshes::displaced_sphere(100_000)),
        ("terrain, 100k", meshes::terrain(100_000)),
        ("room with rods", meshes::room()),
        ("needle sphere", meshes::sliver_sphere(20_000)),
        ("tilted hall", meshes::tilted_hall()),
    ];
    all.extend(generated.map(|(name, m)| (name, m.positions, m.indices)));
    all.into_iter()
        .map(|(name, positions, indices)| {
            Subject::new(name, &positions, &indices, BuildQuality::Medium)
                .map_err(|e| e.to_string())
        })
        .collect()
}

fn main() -> ExitCode {
    let mut wanted = 100_000_000usize;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match (arg.as_str(), args.next().and_then(|v| v.parse().ok())) {
            ("--rays", Some(n)) => wanted = n,
            _ => {
                eprintln!("`{arg}`: the only option is --rays NUMBER");
                return ExitCode::FAILURE;
            }
        }
    }
    match run(wanted) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn run(wanted: usize) -> Result<bool, String> {
    let start = Instant::now();
    let subjects = subjects()?;
    let (mut total, mut judged) = (0, 0);
    let (mut mine, mut theirs) = (Counts::default(), Counts::default());
    for (k, subject) in subjects.iter().enumerate() {
        let share = wanted / subjects.len() + usize::from(k < wanted % subjects.len());
        let ours = OursWide::all(&subject.bvh)
            .pop()
            .ok_or("no kind of instructions")?;
        let embree = EmbreeEngine::new(subject, false).map_err(|e| e.to_string())?;
        let (mut done, mut seed, mut here, mut hits) = (0, 1_000, 0, 0);
        while done < share {
            let rays = subject.random_rays(PART.min(share - done), seed);
            seed += 1;
            done += rays.len();
            let (a, b) = (ours.trace(&rays), embree.trace(&rays));
            hits += a.iter().filter(|x| x.hit.is_some()).count();
            let differ: Vec<usize> = (0..rays.len()).filter(|&i| !agree(&a[i], &b[i])).collect();
            if differ.is_empty() {
                continue;
            }
            here += differ.len();
            let set = RaySet::new(subject, differ.iter().map(|&i| rays[i]).collect());
            let pick = |all: &[Answer]| differ.iter().map(|&i| all[i]).collect();
            mine.add(&compare(subject, &set, &Given(&ours, pick(&a))));
            theirs.add(&compare(subject, &set, &Given(&embree, pick(&b))));
        }
        println!(
            "{}: {done} rays, {hits} hits, {here} differ and were judged, {:.0} s so far",
            subject.name,
            start.elapsed().as_secs_f64()
        );
        (total, judged) = (total + done, judged + here);
    }
    println!("{total} rays, {judged} judged in double precision");
    for (name, c) in [("ours", &mine), ("Embree", &theirs)] {
        println!(
            "{name}: leaks {}, false hits {}, t off {}, weights off {}, occlusion errors {}, \
             contradictions {}, without a name {}; ties {}, rims {}; {}",
            c.leaks,
            c.false_hits,
            c.t_off,
            c.weights_off,
            c.occlusion_errors,
            c.contradictions,
            c.unexplained,
            c.prim_ties,
            c.rims,
            c.causes
        );
    }
    for example in &mine.examples {
        println!("    {example}");
    }
    Ok(mine.errors() + mine.contradictions + mine.unexplained == 0)
}
