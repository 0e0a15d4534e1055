// What LinuxCNC's interpreter asks for (its "canonical commands"), written down in full.
//
// The python module `gcode` of LinuxCNC answers some of these itself and drops the others. This library is loaded before
// it, with its names global, so that the interpreter calls these functions in its place. Positions are turned into
// those of the axes (offsets, rotation and tool length added), in mm and degrees, and written as JSON, one command per
// line, into a buffer that trace.py takes out with canon_take().
//
// The names and the arguments are those of LinuxCNC 2.9, as `nm -DC librs274.so.0` lists them.

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

struct Tran { double x, y, z; };
struct EmcPose { Tran tran; double a, b, c, u, v, w; };
struct CANON_TOOL_TABLE {
    int toolno, pocketno;
    EmcPose offset;
    double diameter, frontangle, backangle;
    int orientation;
};
struct CONTROL_POINT { double x, y, w; };
enum CANON_UNITS { CANON_UNITS_INCHES = 1, CANON_UNITS_MM, CANON_UNITS_CM };
enum CANON_PLANE { CANON_PLANE_XY = 1, CANON_PLANE_YZ, CANON_PLANE_XZ, CANON_PLANE_UV, CANON_PLANE_VW, CANON_PLANE_UW };
enum CANON_MOTION_MODE { CANON_EXACT_STOP = 1, CANON_EXACT_PATH, CANON_CONTINUOUS };
enum CANON_DIRECTION { CANON_STOPPED = 1, CANON_CLOCKWISE, CANON_COUNTERCLOCKWISE };
enum CANON_FEED_REFERENCE { CANON_WORKPIECE = 1, CANON_XYZ };
enum CANON_AXIS { CANON_AXIS_X = 1 };

// From libtooldata.so.0.
extern int tooldata_get(CANON_TOOL_TABLE *tool, int index);
extern int tooldata_put(CANON_TOOL_TABLE tool, int index);

namespace {

struct Pose9 { double of[9]; };

struct World {
    double unit = 1.0; // mm per unit
    CANON_PLANE plane = CANON_PLANE_XY;
    double feed = 0.0, feed_mm = 0.0; // as programmed; in mm when it was programmed, whatever the unit becomes
    int feed_mode = 0;
    Pose9 g5x{}, g92{}, tool{}; // in mm and degrees
    Pose9 at{}, probe{}; // where the axes are, and were when the probe tripped
    double rotation_deg = 0.0;
    int slot = 0;
    double speed = 0.0;
    bool surface = false; // G96
    CANON_DIRECTION turning = CANON_STOPPED;
    int mist = 0, flood = 0;
    bool feed_override = true, speed_override = true, adaptive = false, hold = true;
    CANON_MOTION_MODE mode = CANON_CONTINUOUS;
    double tolerance = 0.0, naive = 0.0;
};

World world;
std::string text;
std::string parameter_file;
bool block_delete = false;

bool linear(int axis) { return axis < 3 || axis > 5; }

void put(const char *format, ...) __attribute__((format(printf, 1, 2)));
void put(const char *format, ...) {
    char line[4096];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    text += line;
    text += '\n';
}

void put_text(const char *kind, const char *words) {
    std::string quoted;
    for (const char *at = words ? words : ""; *at; at++) {
        unsigned char byte = static_cast<unsigned char>(*at);
        if (byte == '"' || byte == '\\') { quoted += '\\'; quoted += *at; }
        else if (byte < 32 || byte > 126) { char code[8]; snprintf(code, sizeof code, "\\u%04x", byte); quoted += code; }
        else quoted += *at;
    }
    text += std::string("[\"") + kind + "\",\"" + quoted + "\"]\n";
}

// A position of the program, in mm and degrees.
Pose9 in_mm(double x, double y, double z, double a, double b, double c, double u, double v, double w) {
    const double f = world.unit;
    return {{x * f, y * f, z * f, a, b, c, u * f, v * f, w * f}};
}

// Where the axes are for a position of the program.
Pose9 of_axes(const Pose9 &program) {
    Pose9 axes = program;
    for (int i = 0; i < 9; i++) axes.of[i] += world.g92.of[i];
    if (world.rotation_deg != 0.0) {
        const double turn = world.rotation_deg * M_PI / 180.0, x = axes.of[0], y = axes.of[1];
        axes.of[0] = x * cos(turn) - y * sin(turn);
        axes.of[1] = x * sin(turn) + y * cos(turn);
    }
    for (int i = 0; i < 9; i++) axes.of[i] += world.g5x.of[i] + world.tool.of[i];
    return axes;
}

// The position of the program for a place of the axes.
Pose9 of_program(const Pose9 &axes) {
    Pose9 program = axes;
    for (int i = 0; i < 9; i++) program.of[i] -= world.g5x.of[i] + world.tool.of[i];
    if (world.rotation_deg != 0.0) {
        const double turn = -world.rotation_deg * M_PI / 180.0, x = program.of[0], y = program.of[1];
        program.of[0] = x * cos(turn) - y * sin(turn);
        program.of[1] = x * sin(turn) + y * cos(turn);
    }
    for (int i = 0; i < 9; i++) program.of[i] -= world.g92.of[i];
    return program;
}

std::string numbers(const Pose9 &pose) {
    std::string all = "[";
    for (int i = 0; i < 9; i++) {
        char one[40];
        const double value = pose.of[i];
        if (std::isfinite(value)) snprintf(one, sizeof one, i ? ",%.17g" : "%.17g", value);
        else snprintf(one, sizeof one, i ? ",null" : "null");
        all += one;
    }
    return all + "]";
}

double sane(double value) { return std::isfinite(value) ? value : -1e300; }

void move(const char *kind, int line, const Pose9 &program) {
    world.at = of_axes(program);
    put("[\"%s\",%d,%s,%.17g,%.17g,%d]", kind, line, numbers(world.at).c_str(), sane(world.feed_mm),
        sane(world.feed), world.feed_mode);
}

} // namespace

extern "C" void canon_reset(const char *parameters, int skip_marked_blocks) {
    world = World();
    text.clear();
    parameter_file = parameters;
    block_delete = skip_marked_blocks != 0;
}

extern "C" const char *canon_take(void) {
    static std::string taken;
    taken.swap(text);
    text.clear();
    return taken.c_str();
}

void INIT_CANON() {}
void USE_LENGTH_UNITS(CANON_UNITS unit) { world.unit = unit == CANON_UNITS_INCHES ? 25.4 : 1.0; }
void SELECT_PLANE(CANON_PLANE plane) { world.plane = plane; }
void SET_G5X_OFFSET(int index, double x, double y, double z, double a, double b, double c, double u, double v, double w) {
    world.g5x = in_mm(x, y, z, a, b, c, u, v, w);
    put("[\"g5x\",%d,%s]", index, numbers(world.g5x).c_str());
}
void SET_G92_OFFSET(double x, double y, double z, double a, double b, double c, double u, double v, double w) {
    world.g92 = in_mm(x, y, z, a, b, c, u, v, w);
    put("[\"g92\",%s]", numbers(world.g92).c_str());
}
void SET_XY_ROTATION(double degrees) {
    world.rotation_deg = degrees;
    put("[\"rotation\",%.17g]", degrees);
}
void USE_TOOL_LENGTH_OFFSET(EmcPose o) {
    world.tool = in_mm(o.tran.x, o.tran.y, o.tran.z, o.a, o.b, o.c, o.u, o.v, o.w);
    put("[\"tool length\",%s]", numbers(world.tool).c_str());
}

void SET_TRAVERSE_RATE(double) {}
void SET_FEED_MODE(int, int mode) { world.feed_mode = mode; }
void SET_FEED_RATE(double rate) {
    world.feed = rate;
    world.feed_mm = rate * world.unit;
}
void SET_FEED_REFERENCE(CANON_FEED_REFERENCE) {}
void SET_FEED_REFERENCE(double) {}
void SET_MOTION_CONTROL_MODE(CANON_MOTION_MODE mode) { world.mode = mode; }
void SET_MOTION_CONTROL_MODE(double tolerance) { world.tolerance = tolerance; }
void SET_MOTION_CONTROL_MODE(CANON_MOTION_MODE mode, double tolerance) {
    world.mode = mode;
    world.tolerance = tolerance;
}
void SET_NAIVECAM_TOLERANCE(double tolerance) { world.naive = tolerance; }

void STRAIGHT_TRAVERSE(int line, double x, double y, double z, double a, double b, double c, double u, double v, double w) {
    move("rapid", line, in_mm(x, y, z, a, b, c, u, v, w));
}
void STRAIGHT_FEED(int line, double x, double y, double z, double a, double b, double c, double u, double v, double w) {
    move("feed", line, in_mm(x, y, z, a, b, c, u, v, w));
}
void STRAIGHT_PROBE(int line, double x, double y, double z, double a, double b, double c, double u, double v, double w,
                    unsigned char) {
    move("probe", line, in_mm(x, y, z, a, b, c, u, v, w));
    world.probe = world.at;
}
void RIGID_TAP(int line, double x, double y, double z, double scale) {
    Pose9 to = of_program(world.at);
    const Pose9 given = in_mm(x, y, z, 0, 0, 0, 0, 0, 0);
    for (int i = 0; i < 3; i++) to.of[i] = given.of[i];
    put("[\"rigid tap\",%d,%s,%.17g]", line, numbers(of_axes(to)).c_str(), scale);
}

namespace {
// The unit vector of one of the program's axes X, Y, Z, along the machine's.
std::string direction(int axis) {
    double unit[3] = {0, 0, 0};
    unit[axis] = 1.0;
    const double turn = world.rotation_deg * M_PI / 180.0, x = unit[0], y = unit[1];
    char text[120];
    snprintf(text, sizeof text, "[%.17g,%.17g,%.17g]", x * cos(turn) - y * sin(turn), x * sin(turn) + y * cos(turn), unit[2]);
    return text;
}
} // namespace

void ARC_FEED(int line, double first_end, double second_end, double first_centre, double second_centre, int turns,
              double axial_end, double a, double b, double c, double u, double v, double w) {
    // The axes of each plane: first, second, the one out of it.
    static const int axes[4][3] = {{0, 1, 2}, {0, 1, 2}, {1, 2, 0}, {2, 0, 1}};
    const int *plane = axes[world.plane <= CANON_PLANE_XZ ? world.plane : CANON_PLANE_XY];
    const double f = world.unit;
    Pose9 end = in_mm(0, 0, 0, a, b, c, u, v, w);
    end.of[plane[0]] = first_end * f;
    end.of[plane[1]] = second_end * f;
    end.of[plane[2]] = axial_end * f;
    Pose9 centre = of_program(world.at);
    centre.of[plane[0]] = first_centre * f;
    centre.of[plane[1]] = second_centre * f;
    put("[\"arc\",%d,%s,%.17g,%.17g,%d,%s,%s,%s,%d]", line, numbers(of_axes(end)).c_str(), sane(world.feed_mm),
        sane(world.feed), world.feed_mode, numbers(of_axes(centre)).c_str(), direction(plane[0]).c_str(),
        direction(plane[1]).c_str(), turns);
    world.at = of_axes(end);
}
void NURBS_FEED(int line, std::vector<CONTROL_POINT> points, unsigned int order) {
    std::string all = "[";
    Pose9 at = of_program(world.at);
    for (size_t i = 0; i < points.size(); i++) {
        at.of[0] = points[i].x * world.unit;
        at.of[1] = points[i].y * world.unit;
        char weight[40];
        snprintf(weight, sizeof weight, ",%.17g]", sane(points[i].w));
        all += (i ? ",[" : "[") + numbers(of_axes(at)) + weight;
    }
    all += "]";
    text += "[\"spline\"," + std::to_string(line) + "," + numbers(of_axes(at)) + ",";
    char rest[128];
    snprintf(rest, sizeof rest, "%.17g,%.17g,%d,%u,", sane(world.feed_mm), sane(world.feed), world.feed_mode,
             order);
    text += rest + all + "]\n";
    world.at = of_axes(at);
}
void DWELL(double seconds) { put("[\"dwell\",%.17g]", sane(seconds)); }

void SET_SPINDLE_MODE(int spindle, double mode) {
    if (spindle == 0) world.surface = mode != 0;
    put("[\"spindle mode\",%d,%.17g]", spindle, mode);
}
void SET_SPINDLE_SPEED(int spindle, double rpm) {
    if (spindle == 0) world.speed = rpm;
    // In G96 it is a cutting speed, in feet per minute where lengths are in inches (emccanon.cc).
    double unit = world.surface && world.unit > 1 ? 0.3048 : 1;
    put("[\"speed\",%d,%.17g]", spindle, sane(rpm) * unit);
}
void START_SPINDLE_CLOCKWISE(int spindle, int) { world.turning = CANON_CLOCKWISE; put("[\"clockwise\",%d]", spindle); }
void START_SPINDLE_COUNTERCLOCKWISE(int spindle, int) {
    world.turning = CANON_COUNTERCLOCKWISE;
    put("[\"counter-clockwise\",%d]", spindle);
}
void STOP_SPINDLE_TURNING(int spindle) { world.turning = CANON_STOPPED; put("[\"spindle stop\",%d]", spindle); }
void ORIENT_SPINDLE(int spindle, double degrees, int mode) { put("[\"orient\",%d,%.17g,%d]", spindle, degrees, mode); }
void WAIT_SPINDLE_ORIENT_COMPLETE(int spindle, double seconds) { put("[\"wait oriented\",%d,%.17g]", spindle, seconds); }
void START_SPEED_FEED_SYNCH() {}
void START_SPEED_FEED_SYNCH(int spindle, double pitch, bool by_speed) {
    put("[\"synchronised\",%d,%.17g,%d]", spindle, pitch * world.unit, by_speed ? 1 : 0);
}
void STOP_SPEED_FEED_SYNCH() { put("[\"not synchronised\"]"); }
void SPINDLE_RETRACT() {}
void SPINDLE_RETRACT_TRAVERSE() {}
void USE_NO_SPINDLE_FORCE() {}

void SELECT_TOOL(int tool) { put("[\"select tool\",%d]", tool); }
void START_CHANGE() {}

namespace {
// The tool of a place in the magazine; place 0 is an empty spindle.
CANON_TOOL_TABLE into_spindle(int slot) {
    CANON_TOOL_TABLE tool = {};
    if (slot > 0) tooldata_get(&tool, slot);
    if (tool.toolno < 0) tool = CANON_TOOL_TABLE{};
    tooldata_put(tool, 0);
    world.slot = slot;
    return tool;
}
} // namespace

void CHANGE_TOOL(int slot) {
    const CANON_TOOL_TABLE tool = into_spindle(slot);
    put("[\"change tool\",%d,%d]", slot, tool.toolno);
}
void CHANGE_TOOL_NUMBER(int slot) {
    const CANON_TOOL_TABLE tool = into_spindle(slot);
    put("[\"tool is\",%d]", tool.toolno);
}
void RELOAD_TOOLDATA() {}
void SET_TOOL_TABLE_ENTRY(int index, int number, EmcPose offset, double diameter, double front, double back, int way) {
    CANON_TOOL_TABLE tool = {};
    tooldata_get(&tool, index);
    tool.toolno = number;
    tool.offset = offset;
    tool.diameter = diameter;
    tool.frontangle = front;
    tool.backangle = back;
    tool.orientation = way;
    tooldata_put(tool, index);
}

void SET_CUTTER_RADIUS_COMPENSATION(double) {}
void START_CUTTER_RADIUS_COMPENSATION(int) {}
void STOP_CUTTER_RADIUS_COMPENSATION(int) {}
void STOP_CUTTER_RADIUS_COMPENSATION() {}

void FLOOD_ON() { world.flood = 1; put("[\"flood\",1]"); }
void FLOOD_OFF() { world.flood = 0; put("[\"flood\",0]"); }
void MIST_ON() { world.mist = 1; put("[\"mist\",1]"); }
void MIST_OFF() { world.mist = 0; put("[\"mist\",0]"); }
void PROGRAM_STOP() { put("[\"stop\"]"); }
void OPTIONAL_PROGRAM_STOP() { put("[\"optional stop\"]"); }
void PALLET_SHUTTLE() { put("[\"pallet\"]"); }
void PROGRAM_END() { put("[\"end\"]"); }
void FINISH() {}
void ON_RESET() {}
void INTERP_ABORT(int, const char *) {}
void COMMENT(const char *) {}
void MESSAGE(char *words) { put_text("message", words); }
void LOG(char *words) { put_text("log", words); }
void LOGOPEN(char *name) { put_text("log file", name); }
void LOGAPPEND(char *name) { put_text("log file", name); }
void LOGCLOSE() {}
void CANON_ERROR(const char *, ...) {}
void PLUGIN_CALL(int, const char *) {}
void IO_PLUGIN_CALL(int, const char *) {}

void DISABLE_FEED_OVERRIDE() { world.feed_override = false; put("[\"feed override\",0]"); }
void ENABLE_FEED_OVERRIDE() { world.feed_override = true; put("[\"feed override\",1]"); }
void DISABLE_SPEED_OVERRIDE(int) { world.speed_override = false; put("[\"speed override\",0]"); }
void ENABLE_SPEED_OVERRIDE(int) { world.speed_override = true; put("[\"speed override\",1]"); }
void DISABLE_ADAPTIVE_FEED() { world.adaptive = false; put("[\"adaptive feed\",0]"); }
void ENABLE_ADAPTIVE_FEED() { world.adaptive = true; put("[\"adaptive feed\",1]"); }
void DISABLE_FEED_HOLD() { world.hold = false; put("[\"feed hold\",0]"); }
void ENABLE_FEED_HOLD() { world.hold = true; put("[\"feed hold\",1]"); }

void CLEAR_AUX_OUTPUT_BIT(int bit) { put("[\"output\",%d,0,\"now\"]", bit); }
void SET_AUX_OUTPUT_BIT(int bit) { put("[\"output\",%d,1,\"now\"]", bit); }
void CLEAR_MOTION_OUTPUT_BIT(int bit) { put("[\"output\",%d,0,\"motion\"]", bit); }
void SET_MOTION_OUTPUT_BIT(int bit) { put("[\"output\",%d,1,\"motion\"]", bit); }
void SET_AUX_OUTPUT_VALUE(int at, double value) { put("[\"analogue output\",%d,%.17g,\"now\"]", at, value); }
void SET_MOTION_OUTPUT_VALUE(int at, double value) { put("[\"analogue output\",%d,%.17g,\"motion\"]", at, value); }
int WAIT(int at, int kind, int how, double seconds) {
    put("[\"wait input\",%d,%d,%d,%.17g]", at, kind, how, seconds);
    return 0;
}
void TURN_PROBE_ON() {}
void TURN_PROBE_OFF() {}
void CLAMP_AXIS(CANON_AXIS) {}
int LOCK_ROTARY(int, int) { return 0; }
int UNLOCK_ROTARY(int, int) { return 0; }

bool GET_BLOCK_DELETE() { return block_delete; }
void SET_BLOCK_DELETE(bool on) { block_delete = on; }
bool GET_OPTIONAL_PROGRAM_STOP() { return false; }
void SET_OPTIONAL_PROGRAM_STOP(bool) {}
int GET_EXTERNAL_QUEUE_EMPTY() { return 1; }
int GET_EXTERNAL_TC_FAULT() { return 0; }
int GET_EXTERNAL_TC_REASON() { return 0; }
int GET_EXTERNAL_AXIS_MASK() { return 0x1ff; }
double GET_EXTERNAL_ANGLE_UNITS() { return 1.0; }
double GET_EXTERNAL_LENGTH_UNITS() { return 1.0; }
CANON_UNITS GET_EXTERNAL_LENGTH_UNIT_TYPE() { return CANON_UNITS_MM; }
int GET_EXTERNAL_DIGITAL_INPUT(int, int otherwise) { return otherwise; }
double GET_EXTERNAL_ANALOG_INPUT(int, double otherwise) { return otherwise; }
double GET_EXTERNAL_FEED_RATE() { return world.feed; }
double GET_EXTERNAL_TRAVERSE_RATE() { return 0.0; }
int GET_EXTERNAL_FLOOD() { return world.flood; }
int GET_EXTERNAL_MIST() { return world.mist; }
CANON_PLANE GET_EXTERNAL_PLANE() { return world.plane; }
double GET_EXTERNAL_SPEED(int) { return world.speed; }
CANON_DIRECTION GET_EXTERNAL_SPINDLE(int) { return world.turning; }
int GET_EXTERNAL_TOOL_SLOT() { return world.slot; }
int GET_EXTERNAL_SELECTED_TOOL_SLOT() { return 0; }
int GET_EXTERNAL_FEED_OVERRIDE_ENABLE() { return world.feed_override; }
int GET_EXTERNAL_SPINDLE_OVERRIDE_ENABLE(int) { return world.speed_override; }
int GET_EXTERNAL_ADAPTIVE_FEED_ENABLE() { return world.adaptive; }
int GET_EXTERNAL_FEED_HOLD_ENABLE() { return world.hold; }
int GET_EXTERNAL_OFFSET_APPLIED() { return 0; }
EmcPose GET_EXTERNAL_OFFSETS() { return EmcPose{}; }
CANON_MOTION_MODE GET_EXTERNAL_MOTION_CONTROL_MODE() { return world.mode; }
double GET_EXTERNAL_MOTION_CONTROL_TOLERANCE() { return world.tolerance; }
double GET_EXTERNAL_MOTION_CONTROL_NAIVECAM_TOLERANCE() { return world.naive; }
CANON_TOOL_TABLE GET_EXTERNAL_TOOL_TABLE(int index) {
    CANON_TOOL_TABLE tool = {};
    tooldata_get(&tool, index);
    return tool;
}
void SET_PARAMETER_FILE_NAME(const char *name) { parameter_file = name; }
void GET_EXTERNAL_PARAMETER_FILE_NAME(char *name, int size) {
    if (size > 0) snprintf(name, static_cast<size_t>(size), "%s", parameter_file.c_str());
}
int GET_EXTERNAL_PROBE_TRIPPED_VALUE() { return 1; }
double GET_EXTERNAL_PROBE_VALUE() { return 1.0; }

double in_units(const Pose9 &pose, int axis) { return pose.of[axis] / (linear(axis) ? world.unit : 1.0); }

#define POSITION(letter, axis)                                                                               \
    double GET_EXTERNAL_POSITION_##letter() { return in_units(of_program(world.at), axis); }                 \
    double GET_EXTERNAL_PROBE_POSITION_##letter() { return in_units(of_program(world.probe), axis); }        \
    double GET_EXTERNAL_TOOL_LENGTH_##letter##OFFSET() { return in_units(world.tool, axis); }
POSITION(X, 0)
POSITION(Y, 1)
POSITION(Z, 2)
POSITION(A, 3)
POSITION(B, 4)
POSITION(C, 5)
POSITION(U, 6)
POSITION(V, 7)
POSITION(W, 8)
