//! What moves in a sequence, frame by frame.

use glam::{Quat, Vec3};
use raytwin_tests::scene::{Camera, Scene};

/// How far a camera moves sideways or forward over a sequence, over the
/// distance to what it looks at.
const CAMERA_STEP: f32 = 0.12;

/// How far a camera or a light turns over a sequence, in radians.
const CAMERA_TURN: f32 = 0.15;
const LIGHT_TURN: f32 = 0.35;

/// How far the ball moves over a sequence, in distances between the rows.
const BALL_STEP: f32 = 1.0;

/// What happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Nothing.
    Still,
    /// The camera moves sideways.
    Pan,
    /// The camera moves forward.
    Dolly,
    /// The camera turns on its place.
    Turn,
    /// A ball moves toward the camera.
    Ball,
    /// The light turns steadily.
    LightTurns,
    /// The light jumps in the middle.
    LightJumps,
    /// The light goes out in the middle.
    LightOff,
}

impl Event {
    /// All.
    pub const ALL: [Self; 8] = [
        Self::Still,
        Self::Pan,
        Self::Dolly,
        Self::Turn,
        Self::Ball,
        Self::LightTurns,
        Self::LightJumps,
        Self::LightOff,
    ];

    /// Name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Still => "still",
            Self::Pan => "camera pans",
            Self::Dolly => "camera dollies",
            Self::Turn => "camera turns",
            Self::Ball => "a ball moves",
            Self::LightTurns => "light turns",
            Self::LightJumps => "light jumps",
            Self::LightOff => "light off",
        }
    }

    /// Whether something changes at once, in the middle.
    #[must_use]
    pub fn jumps(self) -> bool {
        matches!(self, Self::LightJumps | Self::LightOff)
    }
}

/// Where everything is in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Moment {
    pub camera: Camera,
    pub light: Vec3,
    /// How far the moving ball is from its place.
    pub ball: Vec3,
}

/// The frame of an event. The sequence ends where the scene's camera, light and
/// ball are by themselves, but for what jumps.
pub(super) fn moment(
    event: Event,
    camera: Camera,
    scene: &Scene,
    back: Vec3,
    frame: u32,
    frames: u32,
) -> Moment {
    // From -1 up to 0.
    let t = frame as f32 / f32::max(frames as f32 - 1.0, 1.0) - 1.0;
    let after = 2 * frame >= frames;
    let mut out = Moment {
        camera,
        light: scene.light.direction,
        ball: Vec3::ZERO,
    };
    let view = camera.target - camera.eye;
    let turned = |angle: f32| Quat::from_rotation_y(angle) * scene.light.direction;
    match event {
        Event::Still => {}
        Event::Pan => {
            let right = view.cross(camera.up).normalize();
            let step = right * (CAMERA_STEP * view.length() * t);
            out.camera.eye += step;
            out.camera.target += step;
        }
        Event::Dolly => {
            // Forward from its place: behind it there may be a wall.
            let step = view * (CAMERA_STEP * (t + 1.0));
            out.camera.eye += step;
            out.camera.target += step;
        }
        Event::Turn => {
            let turn = Quat::from_axis_angle(camera.up, CAMERA_TURN * t);
            out.camera.target = camera.eye + turn * view;
        }
        Event::Ball => out.ball = back * (BALL_STEP * -(t + 1.0)),
        Event::LightTurns => out.light = turned(-LIGHT_TURN * t),
        Event::LightJumps if after => out.light = turned(LIGHT_TURN),
        // From below the floor nothing gets in.
        Event::LightOff if after => out.light = Vec3::NEG_Y,
        Event::LightJumps | Event::LightOff => {}
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequences_move_by_as_much_whatever_their_length() {
        let scene = Scene::toy_room();
        let at =
            |event, frame, frames| moment(event, scene.camera, &scene, Vec3::NEG_Z, frame, frames);
        for event in Event::ALL {
            let [first, last] = [0, 1].map(|k| at(event, 7 * k, 8));
            assert_eq!(first == last, event == Event::Still, "{event:?}");
            assert_eq!(first, at(event, 0, 64));
            assert_eq!(last, at(event, 63, 64));
            let direction = |m: Moment| (m.camera.target - m.camera.eye).normalize();
            let angle = direction(first).angle_between(direction(last));
            let expected = if event == Event::Turn {
                CAMERA_TURN
            } else {
                0.0
            };
            assert!((angle - expected).abs() < 2e-3, "{event:?}: {angle}");
        }
        // One step, in the middle.
        let light = |frame| at(Event::LightJumps, frame, 8).light;
        assert_eq!(light(0), light(3));
        assert_eq!(light(4), light(7));
        assert_ne!(light(3), light(4));
    }
}
