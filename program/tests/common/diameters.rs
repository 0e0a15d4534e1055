//! Programs of every combination of plane, motion, distance mode and return height, with X as radius (G8) and as diameter (G7).

/// The axes of a plane, first, second and across, and the offset letters that belong to them.
const PLANES: [(&str, [char; 3], [char; 3]); 3] = [
    ("G17", ['X', 'Y', 'Z'], ['I', 'J', 'K']),
    ("G18", ['Z', 'X', 'Y'], ['K', 'I', 'J']),
    ("G19", ['Y', 'Z', 'X'], ['J', 'K', 'I']),
];

/// Each cycle with the words that it needs beside places and levels; `{` `}` stand for the step aside and the level of G87.
const CYCLES: [(&str, &str); 11] = [
    ("G73", "Q1.3"),
    ("G74", ""),
    ("G81", ""),
    ("G82", "P.5"),
    ("G83", "Q1.3"),
    ("G84", ""),
    ("G85", ""),
    ("G86", "P.5"),
    ("G87", "aside"),
    ("G88", "P.5"),
    ("G89", "P.5"),
];

/// Blocks with words along X that are no cycle and no arc.
const OTHERS: [&str; 21] = [
    "G0 X3",
    "G1 X3 Z-1",
    "G53 G0 X3",
    "G92 X3\nG0 X1",
    "G52 X3\nG0 X1",
    "G10 L2 P0 X3\nG0 X1",
    "G10 L2 P0 X3 R30\nG0 X1",
    "G10 L20 P0 X3\nG0 X1",
    "G10 L1 P1 X3\nT1 M6 G43\nG0 X1",
    "G43.1 X3\nG0 X1",
    "G28.1\nG0 X1\nG28 X2",
    "G38.2 X3\nG0 X#5061",
    "G17\nG5.1 X3 Y9 I1 J4",
    "G17\nG5 X3 Y9 I1 J4 P-1 Q-2",
    "G17\nG5.2 P1\nX3 Y9 P1\nX5 Y9 P1\nG5.3",
    "G33 X3 Z-1 K1",
    "G33.1 X3 K1",
    "G18\nG76 P1 Z-4 I-1 J.5 K2 R1.5 Q29.5 H1",
    "G18\nG76 P1 Z-4 I1 J.5 K2",
    "G18 G90\no100 sub\nG0 X2 Z0\nG1 Z-4\nG3 X5 Z-7 I3 K0\no100 endsub\nG0 X8 Z2\nG71 Q100 D.2 I1 R.5",
    "G18 G90\no100 sub\nG0 X5 Z-6\nG1 Z-4\nX2 Z0\no100 endsub\nG0 X8 Z2\nG72 Q100 X8 Z2 D.2 I1 R.5\nG70 Q100 D.2",
];

/// A program in which X is a radius, and the same with diameters.
pub struct Pair {
    /// G8.
    pub radii: String,
    /// G7.
    pub diameters: String,
}

/// All of them.
pub fn pairs() -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (plane, axes, offsets) in PLANES {
        for absolute in [true, false] {
            let distance = if absolute { "G90" } else { "G91" };
            for returns in ["G98", "G99"] {
                let begins = format!("{plane} {distance} {returns} F200 S500 M3\nG0 X6 Y4 Z8\n");
                for cycle in CYCLES {
                    pairs.push(pair(
                        &(begins.clone() + &drilled(cycle, axes, offsets, absolute)),
                    ));
                }
                for arc in arcs(axes, offsets, absolute) {
                    pairs.push(pair(&(begins.clone() + &arc)));
                }
                for block in OTHERS {
                    pairs.push(pair(&format!("{begins}{block}\n")));
                }
            }
        }
    }
    pairs
}

/// Two holes, and a third in a block that says where alone.
fn drilled(
    (code, words): (&str, &str),
    [first, second, across]: [char; 3],
    offsets: [char; 3],
    absolute: bool,
) -> String {
    // Between the same levels: R at 6, the bottom at 1, and 3 for G87.
    let start = match across {
        'X' => 6,
        'Y' => 4,
        _ => 8,
    };
    let (r, bottom, top) = if absolute {
        (6, 1, 3)
    } else {
        (6 - start, -5, 2)
    };
    let words = match words {
        "aside" => format!("{}.5 {}.25 {}{top}", offsets[0], offsets[1], offsets[2]),
        words => words.to_owned(),
    };
    let spindle = if code == "G74" { "M4\n" } else { "" };
    format!(
        "{spindle}{code} {first}2 {second}3 {across}{bottom} R{r} L2 {words}\n{second}5\n{across}{} \nG80\nG0 X1\n",
        if absolute { 2 } else { -4 },
    )
}

/// By the centre, absolute and from the start, by the radius, and a helix of two turns.
fn arcs([first, second, across]: [char; 3], offsets: [char; 3], absolute: bool) -> [String; 6] {
    let place = |axis: char| match axis {
        'X' => 6.0,
        'Y' => 4.0,
        _ => 8.0,
    };
    // A quarter about a centre 4 below the start along the first axis.
    let from = |axis: char| if absolute { place(axis) } else { 0.0 };
    let ends = format!(
        "{first}{} {second}{}",
        from(first) - 4.0,
        from(second) + 4.0
    );
    let deep = format!("{across}{}", from(across) - 2.0);
    let [i, j, _] = offsets;
    let (centre_i, centre_j) = (place(first) - 4.0, place(second));
    [
        format!("G3 {ends} {i}-4 {j}0\nG0 X1\n"),
        format!("G3 {ends} R4\nG0 X1\n"),
        format!("G2 {ends} R-4\nG0 X1\n"),
        format!("G3 {ends} {deep} {i}-4 {j}0 P2\nG0 X1\n"),
        format!("G90.1 G3 {ends} {i}{centre_i} {j}{centre_j}\nG0 X1\n"),
        format!("G2 {i}-4 {deep}\nG0 X1\n"),
    ]
}

fn pair(text: &str) -> Pair {
    Pair {
        radii: format!("G8\n{text}M2\n"),
        diameters: format!("G7\n{}M2\n", in_diameters(text)),
    }
}

/// The same places with X doubled, and the lengths along X of G76.
pub fn in_diameters(text: &str) -> String {
    let line = |line: &str| {
        let along_x = if line.starts_with("G76") { "XIJK" } else { "X" };
        let word = |word: &str| {
            let (letter, value) = word.split_at(word.len().min(1));
            match value.parse::<f64>() {
                Ok(value) if along_x.contains(letter) => format!("{letter}{}", 2.0 * value),
                _ if word == "X#5061" => "X[2*#5061]".to_owned(),
                _ => word.to_owned(),
            }
        };
        let words: Vec<String> = line.split(' ').map(word).collect();
        words.join(" ") + "\n"
    };
    text.lines().map(line).collect()
}
