#![allow(missing_docs, unreachable_pub)]
use host_sim::plant::*;
use host_sim::stability::{linear::*, path::*, tune::*};
use host_sim::*;
use std::time::Instant;
fn main() {
    let arm = config::parse_arm("e", config::DEFAULT_ARM).unwrap().arm;
    let task = config::parse_task("e", config::DEFAULT_TASK).unwrap();
    let law = config::parse_controller("e", config::DEFAULT_CONTROLLER).unwrap();
    let plan = plan::plan(&arm, &task, &plan::PlanOptions::default()).unwrap();
    let p3 = PlantParameters {
        elements: 3,
        ..Default::default()
    };
    let spread = Spread {
        bending_stiffness_scale: vec![0.8, 1.0, 1.2],
        link2_mass_scale: vec![0.9, 1.0, 1.1],
        added_root_inertia_kgm2: vec![0.0, 2.5e-5, 5e-5],
        ..Spread::none()
    };
    for _ in 0..2 {
        let t = Instant::now();
        let r = Report::new(&plan, &p3, &spread, &law, 50).unwrap();
        println!("report {:?}", t.elapsed());
        println!("{:#?}", r.nominal);
        println!("{:?}", r.worst());
        let t = Instant::now();
        let mut printed = law;
        printed.force_projection = shared::law::ForceProjection::AsPrinted;
        let r = Report::new(&plan, &p3, &Spread::none(), &printed, 50).unwrap();
        println!("printed {:?} {:?}", t.elapsed(), r.nominal);
    }
    let v = Spread {
        bending_stiffness_scale: vec![0.9],
        ..Spread::none()
    }
    .variants(&plan, &p3)
    .unwrap();
    let t = Instant::now();
    let p = Prediction::new(&plan, "x", &v[0].1).unwrap();
    println!("prep {:?} open {:?}", t.elapsed(), p.open);
    let t = Instant::now();
    println!("law {:?}", p.errors(&plan, &law));
    println!("{:?}", t.elapsed());
    let image = knots::encode(&plan).unwrap().image;
    for l in [shared::law::LawParameters::FEEDFORWARD, law] {
        for s in [Start::Equilibrium, Start::PlanAtRest] {
            let o = closed_loop::RunOptions {
                law: l,
                limits: cases::default_limits(&plan),
                plant: cases::plant(3, 0.9),
                start: s,
            };
            let r = closed_loop::run::<f64>(&plan, &image, &o).unwrap().summary;
            println!("sim {s:?} {} {}", r.force_error_rms, r.tip_error_rms);
        }
    }
    if std::env::args().len() > 1 {
        let t = Instant::now();
        let o = TuneOptions {
            law,
            plant: p3,
            spread,
            points: 50,
            gain_margin_db: 6.0,
            delay_margin_ticks: 1.0,
            seed: 1,
            particles: 30,
            iterations: 50,
        };
        let tuned = tune(&plan, &o, &|n| {
            if n % 100 == 0 {
                eprintln!("{n}")
            }
        })
        .unwrap();
        println!(
            "tune {:?} {:?} cost {} {:#?}",
            t.elapsed(),
            tuned.law,
            tuned.cost,
            tuned.report.nominal
        );
        println!("{:?}", tuned.report.worst());
        println!("law {:?}", p.errors(&plan, &tuned.law));
        for s in [Start::Equilibrium, Start::PlanAtRest] {
            let o = closed_loop::RunOptions {
                law: tuned.law,
                limits: cases::default_limits(&plan),
                plant: cases::plant(3, 0.9),
                start: s,
            };
            let r = closed_loop::run::<f64>(&plan, &image, &o).unwrap().summary;
            println!("sim {s:?} {} {}", r.force_error_rms, r.tip_error_rms);
        }
    }
}
