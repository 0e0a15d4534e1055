//! Short programs for seeds: each about a second of machine time, together with all that a path is made of.

/// A program and its name in messages.
#[derive(Debug, Clone)]
pub struct ShortProgram {
    /// Name.
    pub name: String,
    /// Text.
    pub text: String,
}

/// In the plane of the first two axes.
const FLAT: [(&str, &str); 6] = [
    (
        "corners",
        "G21 G17 G90 G94\nG1 X6 Y0 F3000\nY5\nX1 Y7\nX0 Y2\nG0 X3 Y3\nM2\n",
    ),
    (
        "circles",
        "G21 G17 G90 G94\nG1 X4 Y0 F4000\nG3 X4 Y0 I-4 J0\nG2 X4 Y0 I-3 J0\nM2\n",
    ),
    (
        "waits",
        "G21 G17 G90 G94\nG0 X5 Y2\nG4 P0.08\nG1 X9 Y-1 F2500\nG4 P0.15\nG2 X5 Y-1 I-2 J0 F2000\nG4 P0.05\nG0 X0 Y0\nM2\n",
    ),
    (
        "waves",
        "G21 G17 G90 G94\nG1 X1 Y0 F3500\nG3 X5 Y0 I2 J0\nG2 X9 Y0 I2 J0\nG3 X13 Y0 I2 J0\nG1 X16 Y1\nM2\n",
    ),
    (
        "facets",
        "G21 G17 G90 G94\nG1 X1 Y0.2 F2400\nX2 Y0.7\nX2.8 Y1.5\nX3.3 Y2.5\nX3.5 Y3.6\nX3.3 Y4.7\nX2.8 Y5.7\nX2 Y6.5\nX1 Y7\nX0 Y7.2\nX-1 Y7\nX-2 Y6\nM2\n",
    ),
    (
        "slow",
        "G21 G17 G90 G94\nG1 X0.4 Y0.3 F300\nG3 X0.4 Y0.3 I-0.2 J0 F400\nG1 X0.2 Y-0.2 F60\nG0 X8 Y8\nM2\n",
    ),
];

/// With a third axis to drill with.
const DRILLING: [(&str, &str); 3] = [
    (
        "holes",
        "G21 G17 G90 G94\nG54\nF2400\nG0 X4 Y1 Z48\nG99 G81 X6 Y2 Z44 R47\nX10 Y4\nG80\nG0 X8 Y0 Z49\nM2\n",
    ),
    (
        "pecks",
        "G21 G17 G90 G94\nG54\nF3000\nG0 X3 Y-2 Z48\nG99 G83 X5 Y-3 Z42 R47 Q2\nG80\nG1 X0 Y0 Z49 F3000\nM2\n",
    ),
    (
        "helix",
        "G21 G17 G90 G94\nG54\nG0 X3 Y0 Z49\nG3 X3 Y0 Z46 I-3 J0 F3000\nG2 X3 Y0 Z48 I-2 J0\nG0 Z49\nM2\n",
    ),
];

/// The programs that go with a machine's axes; none if it has no X and Y.
pub fn short_programs(axes: &[&str]) -> Vec<ShortProgram> {
    let has = |letter: &str| axes.contains(&letter);
    let mut programs: Vec<(&str, &str)> = Vec::new();
    if has("X") && has("Y") {
        programs.extend(FLAT);
        if has("Z") {
            programs.extend(DRILLING);
        }
    }
    programs
        .into_iter()
        .map(|(name, text)| ShortProgram {
            name: format!("{name}.ngc"),
            text: text.into(),
        })
        .collect()
}
