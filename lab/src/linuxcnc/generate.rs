//! Programs drawn from the grammar: one for each seed, the same one every time.

use std::f64::consts::TAU;

use values::{Draw, mutated};

#[path = "generate_values.rs"]
mod values;

/// What is left out as long as one side does not have it.
#[derive(Debug, Clone, Copy)]
pub struct Kinds {
    /// G5 to G5.3.
    pub splines: bool,
    /// G33, G33.1, G76, G84, G74.
    pub spindle_motion: bool,
    /// @ and ^.
    pub polar: bool,
    /// One character of the program is changed.
    pub mutations: bool,
}

/// Appends to the program.
macro_rules! put {
    ($generator:ident, $($text:tt)*) => {{
        let text = format!($($text)*);
        $generator.text += &text;
    }};
}

/// Writes a line as people do.
macro_rules! say {
    ($generator:ident, $($text:tt)*) => {{
        let text = format!($($text)*);
        $generator.line(&text);
    }};
}

struct Generator {
    draw: Draw,
    kinds: Kinds,
    text: String,
    /// Blocks still to be written.
    left: usize,
    label: usize,
    depth: usize,
    plane: usize,
    absolute: bool,
    centre_absolute: bool,
    diameters: bool,
    inverse_time: bool,
    fed: bool,
    /// A block may go on without saying how.
    going_on: bool,
    returning: bool,
    parameters: Vec<String>,
    subroutines: Vec<(usize, bool)>,
    in_subroutine: bool,
}

/// The program of a seed.
pub fn program(seed: u64, kinds: Kinds) -> String {
    let mut generator = Generator {
        draw: Draw::new(seed),
        kinds,
        text: String::new(),
        left: 0,
        label: 100,
        depth: 0,
        plane: 17,
        absolute: true,
        centre_absolute: false,
        diameters: false,
        inverse_time: false,
        fed: false,
        going_on: false,
        returning: false,
        parameters: vec![],
        subroutines: vec![],
        in_subroutine: false,
    };
    generator.whole();
    let mut text = generator.text;
    if kinds.mutations && generator.draw.once_in(8) {
        text = mutated(&text, &mut generator.draw);
    }
    text
}

const AXES_OF: [(usize, [char; 3], [char; 3]); 3] = [
    (17, ['X', 'Y', 'Z'], ['I', 'J', 'K']),
    (18, ['Z', 'X', 'Y'], ['K', 'I', 'J']),
    (19, ['Y', 'Z', 'X'], ['J', 'K', 'I']),
];

/// To seven decimals.
fn round(value: f64) -> f64 {
    (value * 1e7).round() / 1e7
}

impl Generator {
    fn whole(&mut self) {
        let percent = self.draw.once_in(8);
        if percent {
            self.text += "%\n";
        }
        if self.draw.once_in(3) {
            self.text += "(a program of the fuzzer)\n";
        }
        if self.draw.once_in(3) {
            let units = self
                .draw
                .pick(&["G20", "G21", "G21 G90 G94", "G17 G20 G40 G49 G54 G80"]);
            self.line(units);
        }
        if !self.draw.once_in(12) {
            let feed = 50 + self.draw.below(3000);
            say!(self, "F{feed}");
            self.fed = true;
        }
        if self.draw.once_in(3) {
            self.line("S1000 M3");
        }
        self.left = 1 + self.draw.below(20);
        while self.left > 0 {
            self.left -= 1;
            self.block();
        }
        self.said();
        match (percent, self.draw.below(4)) {
            (true, _) => self.text += "%\n",
            (false, 0) => self.text += "M30\n",
            (false, _) => self.text += "M2\n",
        }
    }

    /// What is compared at the end beside the motions.
    fn said(&mut self) {
        for _ in 0..self.draw.below(4) {
            let mut text = String::from("(DEBUG,");
            for _ in 0..=self.draw.below(3) {
                let name = self.any_parameter();
                text += &format!(" {name}");
            }
            put!(self, "{text})\n");
        }
    }

    fn block(&mut self) {
        match self.draw.below(100) {
            0..=24 => self.travel(),
            25..=37 => self.arc(),
            38..=51 => self.assign(),
            52..=60 => self.flow(),
            61..=66 => self.mode(),
            67..=75 => self.offset(),
            76..=79 => self.tool(),
            80..=86 => self.cycle(),
            87..=92 => self.machine(),
            93..=94 => self.home(),
            95 => {
                self.text += self.draw.pick(&[
                    "\n",
                    "(MSG,hello)\n",
                    "; nothing\n",
                    "(nothing)\n",
                    "/G4 P.5\n",
                ])
            }
            _ => self.special(),
        }
    }

    fn travel(&mut self) {
        let code = self.draw.pick(&["G0", "G1", "G1", "G01", "G00", ""]);
        let code = if code.is_empty() && !self.going_on {
            "G1"
        } else {
            code
        };
        self.going_on = true;
        let axes = self.axis_words(1);
        let feed = if code.ends_with('0') && !self.inverse_time {
            String::new()
        } else {
            self.feed_word()
        };
        let more = if self.draw.once_in(15) {
            self.draw
                .pick(&[" M8", " S500", " M5", " G4 P.1", " G90", " G91", " M3"])
        } else {
            ""
        };
        match more {
            " G90" => self.absolute = true,
            " G91" => self.absolute = false,
            _ => {}
        }
        let words = format!("{code}{axes}{feed}{more}");
        self.line(words.trim());
    }

    /// An arc whose ends lie on one circle.
    /// Goes to a place that the generator knows, in absolute mode.
    fn known_place(&mut self, axes: [char; 3]) -> [f64; 2] {
        let at = [
            self.draw.between(-20.0, 20.0),
            self.draw.between(-20.0, 20.0),
        ]
        .map(round);
        if self.absolute || self.centre_absolute {
            if !self.absolute {
                self.text += "G90\n";
                self.absolute = true;
            }
            let (feed, way) = if self.inverse_time {
                (" F10", "G1")
            } else {
                ("", "G0")
            };
            let words = self.place_words(axes, at);
            put!(self, "{way}{words}{feed}\n");
        }
        at
    }

    /// The words that lead to a place in the plane.
    fn place_words(&self, axes: [char; 3], at: [f64; 2]) -> String {
        let word = |(axis, value): (&char, f64)| match (axis, self.diameters) {
            ('X', true) => format!(" X{}", 2.0 * value),
            _ => format!(" {axis}{value}"),
        };
        axes.iter().zip(at).map(word).collect()
    }

    fn arc(&mut self) {
        self.going_on = false;
        let plane = AXES_OF.iter().find(|(code, ..)| *code == self.plane);
        let Some((_, axes, centres)) = plane.copied() else {
            return;
        };
        let (radius, start, sweep) = (
            self.draw.between(0.5, 30.0),
            self.draw.between(0.0, TAU),
            self.draw.between(0.05, TAU),
        );
        let full = self.draw.once_in(6);
        let code = self.draw.pick(&["G2", "G3"]);
        let turned = start + if code == "G3" { sweep } else { -sweep };
        let centre = [-radius * start.cos(), -radius * start.sin()].map(round);
        let mut end = [
            centre[0] + radius * turned.cos(),
            centre[1] + radius * turned.sin(),
        ]
        .map(round);
        if full {
            end = [0.0; 2];
        }
        let at = self.known_place(axes);
        if self.absolute || self.centre_absolute {
            end = [end[0] + at[0], end[1] + at[1]].map(round);
        }
        let mut words = code.to_owned();
        if !full || self.draw.once_in(2) {
            words += &self.place_words(axes, end);
        }
        if self.draw.once_in(4) {
            words += &format!(" {}{}", axes[2], self.number());
        }
        if !full && self.draw.once_in(3) {
            let sign = if sweep > TAU / 2.0 { -1.0 } else { 1.0 };
            words += &format!(" R{}", round(sign * radius));
        } else {
            let from = if self.centre_absolute { at } else { [0.0; 2] };
            words += &format!(
                " {}{} {}{}",
                centres[0],
                round(centre[0] + from[0]),
                centres[1],
                round(centre[1] + from[1])
            );
            if self.draw.once_in(6) {
                words += &format!(" P{}", 1 + self.draw.below(4));
            }
        }
        words += &self.feed_word();
        self.line(&words);
    }

    fn assign(&mut self) {
        let name = self.name();
        let value = match self.draw.below(3) {
            0 => self.number(),
            _ => format!("[{}]", self.expression(3)),
        };
        let mut words = format!("{name}={value}");
        if self.draw.once_in(8) {
            // The values of a block count from the next one on.
            let motion = self.axis_words(1);
            words += &motion;
            if !self.fed || self.inverse_time {
                words += " F100";
                self.fed = true;
            }
        }
        if self.draw.once_in(10) {
            words += &format!(" {}={}", self.name(), self.number());
        }
        self.line(&words);
        if !self.in_subroutine && self.depth == 0 && !self.parameters.contains(&name) {
            self.parameters.push(name);
        }
    }

    fn some_blocks(&mut self) {
        self.depth += 1;
        self.going_on = false;
        self.returning = false;
        for _ in 0..=self.draw.below(3) {
            self.block();
        }
        self.going_on = false;
        self.returning = false;
        self.depth -= 1;
    }

    fn flow(&mut self) {
        if self.depth > 2 {
            return self.travel();
        }
        self.label += 1;
        let label = self.label;
        match self.draw.below(6) {
            0 => {
                put!(self, "o{label} if [{}]\n", self.expression(2));
                self.some_blocks();
                if self.draw.once_in(3) {
                    put!(self, "o{label} elseif [{}]\n", self.expression(2));
                    self.some_blocks();
                }
                if self.draw.once_in(2) {
                    put!(self, "o{label} else\n");
                    self.some_blocks();
                }
                put!(self, "o{label} endif\n");
            }
            1 => {
                put!(self, "O{label} REPEAT [{}]\n", self.draw.below(4));
                self.some_blocks();
                put!(self, "O{label} ENDREPEAT\n");
            }
            2 => {
                let counter = format!("#{}", 200 + label);
                put!(
                    self,
                    "{counter}=0\no{label} while [{counter} lt {}]\n",
                    self.draw.below(4)
                );
                self.some_blocks();
                if self.draw.once_in(4) {
                    put!(
                        self,
                        "o{label} {}\n",
                        self.draw
                            .pick(&["break", "continue"])
                            .replace("continue", "break")
                    );
                }
                put!(self, "{counter}=[{counter}+1]\no{label} endwhile\n");
            }
            3 => {
                let counter = format!("#{}", 200 + label);
                put!(self, "{counter}=0\no{label} do\n");
                self.some_blocks();
                put!(
                    self,
                    "{counter}=[{counter}+1]\no{label} while [{counter} lt {}]\n",
                    self.draw.below(4)
                );
            }
            4 if self.depth == 0 && !self.in_subroutine => self.subroutine(label),
            _ => self.call(),
        }
        // A branch may have left it open what holds.
        if self.depth == 0 {
            self.settle();
        }
    }

    fn subroutine(&mut self, label: usize) {
        self.in_subroutine = true;
        let outside = std::mem::take(&mut self.parameters);
        put!(self, "o{label} sub\n");
        self.parameters = vec!["#1".into(), "#2".into()];
        self.some_blocks();
        if self.draw.once_in(3) {
            put!(self, "o{label} return [{}]\n", self.expression(2));
        }
        put!(self, "o{label} endsub\n");
        if self.draw.once_in(3) {
            self.text += "G90\n";
        }
        self.absolute = true;
        self.text += "G90\n";
        self.parameters = outside;
        self.in_subroutine = false;
        self.subroutines.push((label, true));
        self.call();
    }

    fn call(&mut self) {
        let known = self.subroutines.len();
        if known == 0 || self.in_subroutine {
            return self.travel();
        }
        let (label, _) = self.subroutines[self.draw.below(known)];
        let mut words = format!("o{label} call");
        for _ in 0..self.draw.below(4) {
            words += &format!(" [{}]", self.expression(1));
        }
        put!(self, "{words}\n");
        self.settle();
    }

    /// Says what the generator counts with.
    fn settle(&mut self) {
        self.going_on = false;
        let distance = if self.absolute { "G90" } else { "G91" };
        let centre = if self.centre_absolute {
            "G90.1"
        } else {
            "G91.1"
        };
        let feed = if self.inverse_time { "G93" } else { "G94" };
        let x = if self.diameters { "G7" } else { "G8" };
        let plane = self.plane;
        put!(self, "G{plane} {distance} {centre} {feed} {x} F100\n");
    }

    fn mode(&mut self) {
        let word = self.draw.pick(&[
            "G17",
            "G18",
            "G19",
            "G90",
            "G91",
            "G90.1",
            "G91.1",
            "G20",
            "G21",
            "G93",
            "G94",
            "G61",
            "G64",
            "G64 P.01",
            "G64 P.05 Q.02",
            "G61.1",
            "G40",
            "G49",
            "G80",
            "G98",
            "G99",
            "G97",
            "G8",
            "G7",
            "M70",
            "G18 G91",
            "G17 G90",
        ]);
        for code in word.split(' ') {
            match code {
                "G17" => self.plane = 17,
                "G18" => self.plane = 18,
                "G19" => self.plane = 19,
                "G90" => self.absolute = true,
                "G91" => self.absolute = false,
                "G7" => self.diameters = true,
                "G8" => self.diameters = false,
                "G90.1" => self.centre_absolute = true,
                "G91.1" => self.centre_absolute = false,
                "G93" => self.inverse_time = true,
                "G94" => {
                    self.inverse_time = false;
                    self.fed = false;
                }
                _ => {}
            }
        }
        self.going_on &= word != "G80";
        self.line(word);
    }

    fn offset(&mut self) {
        let axes = self.axis_words(1);
        match self.draw.below(14) {
            0 | 1 => {
                let system = self.draw.below(10);
                say!(self, "G10 L2 P{system}{axes}");
            }
            2 => {
                let (system, turn) = (self.draw.below(10), self.number());
                say!(self, "G10 L2 P{system} X{} R{turn}", self.draw.below(9));
            }
            3 => {
                let system = self.draw.below(10);
                say!(self, "G10 L20 P{system}{axes}");
            }
            4 | 5 => {
                let system = self.draw.pick(&[
                    "G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3",
                ]);
                self.line(system);
            }
            6 => say!(self, "G52{axes}"),
            7 => say!(self, "G92{axes}"),
            8 => {
                let word = self.draw.pick(&["G92.1", "G92.2", "G92.3"]);
                self.line(word);
            }
            9 | 10 => {
                let (code, feed) = if self.draw.once_in(2) {
                    ("G0", String::new())
                } else {
                    ("G1", self.feed_word())
                };
                say!(self, "G53 {code}{axes}{feed}");
            }
            11 => {
                let index = self.draw.below(5) + 1;
                say!(self, "G10 L1 P{index} Z{}", self.number());
            }
            12 => {
                let (index, way) = (self.draw.below(5) + 1, self.draw.pick(&["L10", "L11"]));
                say!(self, "G10 {way} P{index} Z{}", self.number());
            }
            _ => say!(
                self,
                "#{}={}",
                5221 + 20 * self.draw.below(9),
                self.draw.below(20)
            ),
        }
    }

    fn tool(&mut self) {
        let number = self
            .draw
            .pick(&["1", "2", "3", "4", "5", "10", "20", "99", "0"]);
        let words = match self.draw.below(9) {
            0 => format!("T{number} M6"),
            1 => format!("T{number}"),
            2 if number != "0" => format!("T{number} M6 G43"),
            3 => format!("M6 T{number} G43 H{number}"),
            4 => "G43".to_owned(),
            5 => format!("G43 H{number}"),
            6 => format!("G43.1{}", self.axis_words(1)),
            7 => format!("G43.2 H{number}"),
            _ => self
                .draw
                .pick(&["G49", "M61 Q3", "M61 Q0", "M6"])
                .to_owned(),
        };
        self.line(&words);
    }

    fn cycle(&mut self) {
        if self.inverse_time {
            return;
        }
        let plane = AXES_OF.iter().find(|(code, ..)| *code == self.plane);
        let Some((_, axes, _)) = plane.copied() else {
            return;
        };
        let mut code = self
            .draw
            .pick(&["G81", "G82", "G83", "G73", "G85", "G86", "G89"]);
        if self.kinds.spindle_motion && self.draw.once_in(5) {
            code = self.draw.pick(&["G84", "G74"]);
        }
        self.going_on = false;
        // Without either, theirs begins in G99 and ours in G98.
        let returning = self.draw.pick(&["", "G98 ", "G99 ", "G98 "]);
        let returning = if self.returning { returning } else { "G98 " };
        self.returning = self.depth == 0;
        let (clear, depth) = (self.draw.below(10) + 1, self.draw.between(0.5, 20.0));
        if self.draw.once_in(4) {
            put!(self, "G0 {}{}\n", axes[2], self.draw.below(30));
        }
        if matches!(code, "G86" | "G84" | "G74") {
            self.text += "S500 M3\n";
        }
        let below = if self.absolute {
            clear as f64 - depth
        } else {
            -depth
        };
        let mut words = format!("{returning}{code}");
        for axis in axes.iter().take(2).filter(|_| true) {
            if !self.draw.once_in(5) {
                words += &format!(" {axis}{}", self.number());
            }
        }
        words += &format!(" {}{below:.3} R{clear}", axes[2]);
        if matches!(code, "G82" | "G86" | "G89") {
            words += &format!(" P{}", self.draw.below(3));
        }
        if matches!(code, "G83" | "G73") {
            words += &format!(" Q{:.2}", self.draw.between(0.5, 6.0));
        }
        if self.draw.once_in(4) {
            words += &format!(" L{}", 1 + self.draw.below(3));
        }
        words += &self.feed_word();
        self.line(&words);
        for _ in 0..self.draw.below(3) {
            let axis = axes[self.draw.below(2)];
            let again = format!("{axis}{}", self.number());
            self.line(&again);
        }
        if !self.draw.once_in(5) {
            self.line("G80");
        }
    }

    fn machine(&mut self) {
        let word = self.draw.pick(&[
            "M3",
            "M4 S200",
            "M5",
            "M7",
            "M8",
            "M9",
            "M0",
            "M1",
            "M60",
            "M48",
            "M49",
            "S750",
            "M3 S1200",
            "M19 R90",
            "M62 P1",
            "M63 P2",
            "M64 P3",
            "M65 P0",
            "M67 E1 Q2.5",
            "M68 E0 Q-1",
            "M66 P0 L0",
            "M66 E1 L0",
            "G4 P1",
            "G4 P.25",
            "M50 P0",
            "M51 P0",
            "M52 P1",
            "M53 P0",
            "M70",
            "M71",
            "M73",
            "M5 M9",
            "G96 D1000 S50",
            "G96 S30",
            "G97 S400",
            "S60",
            "M72",
        ]);
        self.line(word);
    }

    fn home(&mut self) {
        self.going_on = false;
        let word = self.draw.pick(&["G28", "G30", "G28.1", "G30.1"]);
        let axes = if word.len() == 3 && self.draw.once_in(2) {
            self.axis_words(1)
        } else {
            String::new()
        };
        say!(self, "{word}{axes}");
    }

    fn special(&mut self) {
        self.going_on = false;
        match self.draw.below(4) {
            0 => {
                let code = self.draw.pick(&["G38.2", "G38.3", "G38.4", "G38.5"]);
                let (axis, feed) = (self.draw.pick(&["X", "Y", "Z"]), 10 + self.draw.below(500));
                self.fed = true;
                put!(self, "{code} {axis}{} F{feed}\n", self.number());
            }
            1 if self.kinds.splines => {
                let code = self.draw.pick(&["G5", "G5.1"]);
                put!(
                    self,
                    "G0 X1 Y1\n{code} X{} Y{} I{} J{} P-1 Q1\n",
                    self.number(),
                    self.number(),
                    self.number(),
                    self.number()
                );
            }
            2 if self.kinds.polar => {
                let code = self.draw.pick(&["G0", "G1"]);
                let feed = self.feed_word();
                put!(
                    self,
                    "{code} @{} ^{}{feed}\n",
                    self.draw.below(30),
                    self.number()
                );
            }
            _ => self.travel(),
        }
    }
}
