//! What a machine has beside two masses and a screw, as a tool, a scale and a drive see it.

use std::f64::consts::PI;
use std::path::Path;

use machine::Machine;
use master::{DriveCommand, Drives};
use plant_sim::SimulatedDrives;
use plant_sim::plant_file::{PlantCrossTalk, PlantFile, PlantFrame, PlantMeasuredFriction};

/// The drives of a shipped machine whose plant is another one, with scales that show everything.
fn drives(edit: impl Fn(&mut PlantFile)) -> SimulatedDrives {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let machine = Machine::load(&folder).expect("the machine");
    let mut plant = PlantFile::load(&folder).expect("the plant");
    for axis in &mut plant.axes {
        if let Some(scale) = &mut axis.scale {
            scale.resolution_nm = 0.1;
        }
    }
    edit(&mut plant);
    plant.drives(&machine).expect("axes")
}

fn velocities(of_x_mm_s: f64, of_y_mm_s: f64) -> [DriveCommand; 2] {
    [of_x_mm_s, of_y_mm_s].map(|velocity_mm_s| DriveCommand::Velocity {
        velocity_mm_s,
        torque_offset_nm: 0.0,
    })
}

/// Where a tool sees the table.
fn seen_mm(drives: &SimulatedDrives, axis: usize) -> f64 {
    let samples = drives.instruments(axis);
    samples.last().expect("a sample").table_mm
}

fn scale_mm(drives: &SimulatedDrives, axis: usize) -> f64 {
    drives.feedback(axis).scale_position_mm.expect("a scale")
}

#[test]
fn a_frame_gives_way_to_the_force_of_its_table_and_rings_where_only_the_tool_sees_it() {
    let mut drives = drives(|plant| {
        plant.axes[0].frame = Some(PlantFrame {
            mass_kg: 1000.0,
            frequency_hz: 35.0,
            damping_ratio: 0.005,
        });
    });
    let beside_um = |drives: &SimulatedDrives| (seen_mm(drives, 0) - scale_mm(drives, 0)) * 1e3;
    // 2 m/s² for 0.1 s, and no more than a frame that swings: mean of the force over the stiffness.
    let (mut velocity_mm_s, mut sum_um) = (0.0, 0.0);
    for _ in 0..100 {
        velocity_mm_s += 2.0;
        drives.exchange(&velocities(velocity_mm_s, 0.0));
        sum_um += beside_um(&drives);
    }
    let stiffness_n_per_um = 1000.0 * (2.0 * PI * 35.0_f64).powi(2) * 1e-6;
    let expected_um = -100.0 * 2.0 / stiffness_n_per_um;
    let mean_um = sum_um / 100.0;
    assert!(
        (mean_um / expected_um - 1.0).abs() < 0.25,
        "{mean_um} µm, {expected_um} µm"
    );
    // It goes on at a constant speed: the frame rings, with the table as the drive holds it.
    let (mut crossings, mut before_um, mut most_um) = (0, beside_um(&drives), 0.0_f64);
    for _ in 0..1000 {
        drives.exchange(&velocities(velocity_mm_s, 0.0));
        let now_um = beside_um(&drives);
        crossings += u32::from(before_um * now_um < 0.0);
        most_um = most_um.max(now_um.abs());
        before_um = now_um;
    }
    assert!((64..=72).contains(&crossings), "{crossings}");
    assert!(most_um > 1.0, "{most_um} µm");
    // The other axis stands on ground that does not move.
    assert!((seen_mm(&drives, 1) - scale_mm(&drives, 1)).abs() < 1e-6);
}

fn cross_talk(plant: &mut PlantFile, at_mm: f64) {
    plant.axes[0].cross_talk = vec![PlantCrossTalk {
        from: "Y".into(),
        squareness_um_per_m: 20.0,
        straightness_um: 1.5,
        straightness_length_mm: 400.0,
        friction_share_per_m: 1.0,
    }];
    plant.axes[1].start_position_mm = at_mm;
}

#[test]
fn a_tool_sees_an_axis_lean_with_another_one_and_its_encoder_does_not() {
    for (at_mm, expected_um) in [(0.0, 0.0), (100.0, 3.5), (200.0, 4.0), (-100.0, -3.5)] {
        let mut drives = drives(|plant| cross_talk(plant, at_mm));
        for _ in 0..20 {
            drives.exchange(&velocities(0.0, 0.0));
        }
        let [x_um, y_um] =
            [0, 1].map(|axis| (seen_mm(&drives, axis) - scale_mm(&drives, axis)) * 1e3);
        assert!((x_um - expected_um).abs() < 1e-3, "Y{at_mm}: {x_um} µm");
        assert!(y_um.abs() < 1e-3, "nothing disturbs Y: {y_um} µm");
        assert!(drives.feedback(0).motor_position_mm.abs() < 1e-4);
    }
}

#[test]
fn an_axis_rubs_more_where_another_one_loads_its_guideways() {
    let torque_nm = |at_mm: f64| {
        let mut drives = drives(|plant| {
            cross_talk(plant, at_mm);
            plant.axes[0].motor.cogging_torque_nm = 0.0;
            plant.axes[0].motor.friction.viscous_nm_s_per_rad = 0.0;
            plant.axes[0].table.friction.viscous_n_s_per_m = 0.0;
        });
        for _ in 0..1500 {
            drives.exchange(&velocities(50.0, 0.0));
        }
        drives.feedback(0).torque_nm
    };
    let ratio = torque_nm(200.0) / torque_nm(0.0);
    assert!((ratio - 1.2).abs() < 0.005, "{ratio}");
    let ratio = torque_nm(-100.0) / torque_nm(0.0);
    assert!((ratio - 0.9).abs() < 0.005, "{ratio}");
}

#[test]
fn a_drive_needs_the_force_that_was_measured() {
    let mut drives = drives(|plant| {
        plant.axes[0].motor.cogging_torque_nm = 0.0;
        plant.axes[0].measured_friction = Some(PlantMeasuredFriction {
            speed_mm_s: vec![-100.0, -10.0, 10.0, 100.0],
            force_n: vec![-700.0, -500.0, 400.0, 550.0],
        });
    });
    let radius_m = 0.01 / (2.0 * PI);
    for (velocity_mm_s, expected_n) in [
        (10.0, 400.0),
        (55.0, 475.0),
        (100.0, 550.0),
        (130.0, 600.0),
        (-100.0, -700.0),
        (-1.0, -500.0),
    ] {
        for _ in 0..1500 {
            drives.exchange(&velocities(velocity_mm_s, 0.0));
        }
        let force_n = drives.feedback(0).torque_nm / radius_m;
        assert!(
            (force_n - expected_n).abs() < 5.0,
            "{velocity_mm_s} mm/s: {force_n} N, {expected_n} N"
        );
    }
}

#[test]
fn drives_that_were_saved_and_restored_go_on_with_their_frame_and_their_neighbours() {
    let plant = |plant: &mut PlantFile| {
        cross_talk(plant, 50.0);
        plant.axes[0].frame = Some(PlantFrame {
            mass_kg: 1000.0,
            frequency_hz: 35.0,
            damping_ratio: 0.05,
        });
    };
    let run = || {
        let mut drives = drives(plant);
        for scan in 0..300 {
            drives.exchange(&velocities(f64::from(scan), 0.5 * f64::from(scan)));
        }
        let mut bytes = vec![0; drives.state_bytes()];
        drives.save(&mut bytes);
        let mut after = self::drives(plant);
        after.restore(&bytes).expect("a state that was saved");
        let places = [0, 1].map(|axis| (scale_mm(&drives, axis), scale_mm(&after, axis)));
        // It braked from where it was, and did not jump.
        for (before_mm, after_mm) in places {
            let further_mm = after_mm - before_mm;
            assert!((0.0..30.0).contains(&further_mm), "{further_mm} mm");
        }
        for _ in 0..100 {
            after.exchange(&[DriveCommand::SwitchOn; 2]);
        }
        (seen_mm(&after, 0), seen_mm(&after, 1))
    };
    assert_eq!(run(), run());
}
