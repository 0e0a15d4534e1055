#![allow(clippy::indexing_slicing, clippy::expect_used)]

use super::*;

fn probe() -> PlantProbe {
    PlantProbe {
        tip_radius_mm: 2.0,
        length_mm: 0.0,
        overtravel_mm: 3.0,
        repeatability_um: 0.0,
        seed: 1,
        planes: vec![],
        boxes: vec![],
        spheres: vec![],
        cylinders: vec![],
        bores: vec![],
    }
}

fn simulated(settings: PlantProbe) -> SimulatedProbe {
    SimulatedProbe::new(settings, [Some(0), Some(1), Some(2)])
}

#[test]
fn clearances_of_the_bodies_are_what_a_ruler_says() {
    let plane = PlantProbe {
        planes: vec![PlantPlane {
            point_mm: [0.0, 0.0, -10.0],
            normal: [0.0, 0.0, 0.5],
        }],
        ..probe()
    };
    let of_box = PlantProbe {
        boxes: vec![PlantBox {
            low_mm: [0.0, 0.0, 0.0],
            high_mm: [10.0, 20.0, 30.0],
        }],
        ..probe()
    };
    let sphere = PlantProbe {
        spheres: vec![PlantSphere {
            centre_mm: [1.0, 2.0, 3.0],
            radius_mm: 5.0,
        }],
        ..probe()
    };
    let rod = PlantCylinder {
        from_mm: [0.0, 0.0, -10.0],
        to_mm: [0.0, 0.0, 10.0],
        radius_mm: 4.0,
    };
    let cylinder = PlantProbe {
        cylinders: vec![rod],
        ..probe()
    };
    let bored = PlantProbe {
        bores: vec![PlantCylinder {
            radius_mm: 8.0,
            ..rod
        }],
        planes: vec![PlantPlane {
            point_mm: [0.0, 0.0, 5.0],
            normal: [0.0, 0.0, 1.0],
        }],
        ..probe()
    };
    for (settings, at, clearance_mm) in [
        (&plane, [7.0, 8.0, 0.0], 8.0),
        (&plane, [7.0, 8.0, -11.0], -3.0),
        (&of_box, [5.0, 10.0, 40.0], 8.0),
        (&of_box, [13.0, 24.0, 15.0], 3.0),
        (&of_box, [5.0, 19.0, 15.0], -3.0),
        (&sphere, [11.0, 2.0, 3.0], 3.0),
        (&cylinder, [0.0, 9.0, 0.0], 3.0),
        (&cylinder, [0.0, 0.0, 15.0], 3.0),
        (&cylinder, [7.0, 0.0, 14.0], 3.0),
        (&bored, [0.0, 1.0, 0.0], 5.0),
        (&bored, [0.0, 7.5, 0.0], -1.5),
        (&bored, [20.0, 0.0, 0.0], -7.0),
        (&probe(), [0.0; 3], f64::INFINITY),
    ] {
        let found = simulated(settings.clone()).clearance_mm(&at);
        let same = found == clearance_mm || (found - clearance_mm).abs() < 1e-12;
        assert!(same, "{at:?}: {found} mm, not {clearance_mm}");
    }
}

/// Down onto a plane in steps of a scan of four samples, and up again; contact made and lost, as times in scans.
fn down_and_up(settings: PlantProbe, speed_mm_scan: f64, scans: u32) -> (SimulatedProbe, Vec<f64>) {
    let mut sim = simulated(settings);
    let height = |time: f64| {
        let half = f64::from(scans) / 2.0;
        (time - half).abs() * speed_mm_scan - 1.0
    };
    sim.stand(|axis| if axis == 2 { height(0.0) } else { 0.0 });
    let mut times = Vec::new();
    for scan in 0..scans {
        sim.scan(4, |axis, sample| {
            let time = f64::from(scan) + (sample + 1) as f64 / 4.0;
            if axis == 2 { height(time) } else { 0.0 }
        });
        let mut shown = InputFeedback::default();
        sim.show(&mut shown);
        let changes = [shown.made_at, shown.lost_at].into_iter().flatten();
        times.extend(changes.map(|share| f64::from(scan) + share));
    }
    (sim, times)
}

#[test]
fn the_instant_of_contact_is_that_of_the_ball_on_the_surface() {
    // The ball of 2 mm comes to the plane with its centre at 2 mm.
    let settings = PlantProbe {
        planes: vec![PlantPlane {
            point_mm: [0.0, 0.0, -0.005],
            normal: [0.0, 0.0, 1.0],
        }],
        ..probe()
    };
    let (sim, times) = down_and_up(settings, 0.03, 400);
    let expected = [200.0 - (1.995 + 1.0) / 0.03, 200.0 + (1.995 + 1.0) / 0.03];
    assert_eq!(times.len(), 2);
    for (time, expected) in times.iter().zip(expected) {
        assert!((time - expected).abs() < 1e-6, "{time}, not {expected}");
    }
    assert_eq!(sim.state.contacts, 1);
}

#[test]
fn a_stylus_that_is_pushed_too_far_breaks_and_shows_contact_for_good() {
    let settings = PlantProbe {
        planes: vec![PlantPlane {
            point_mm: [0.0, 0.0, 1.0],
            normal: [0.0, 0.0, 1.0],
        }],
        overtravel_mm: 3.5,
        ..probe()
    };
    let (sim, times) = down_and_up(settings, 0.03, 400);
    assert_eq!(times.len(), 1);
    assert_eq!((sim.state.broken, sim.state.contact), (1, 1));
}

#[test]
fn the_noise_is_as_wide_as_stated_and_the_same_for_a_seed() {
    let settings = |seed| PlantProbe {
        repeatability_um: 2.0,
        seed,
        ..probe()
    };
    let drawn = |seed: u64| -> Vec<f64> {
        let mut sim = simulated(settings(seed));
        let each = (0..4000).map(|contacts| {
            sim.state.contacts = contacts;
            sim.noise_mm() * 1e3
        });
        each.collect()
    };
    let noise = drawn(7);
    let mean = noise.iter().sum::<f64>() / noise.len() as f64;
    let variance = noise.iter().map(|x| x * x).sum::<f64>() / noise.len() as f64;
    assert!(mean.abs() < 0.15, "{mean} µm");
    assert!(
        (variance.sqrt() - 2.0).abs() < 0.1,
        "{} µm",
        variance.sqrt()
    );
    assert_eq!(noise, drawn(7));
    assert_ne!(noise, drawn(8));
}
