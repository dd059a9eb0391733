//! The robot's sensors: clouds, IMU samples, and the frames they are mounted in.

use std::time::{SystemTime, UNIX_EPOCH};

use serde::Deserialize;

use crate::messages::*;

const FLOAT32: u8 = 7; // of sensor_msgs/PointField
const POINT_STEP: usize = 16; // x, y, z, intensity

/// A fixed frame: translation in metres, rotation as x, y, z, w.
#[derive(Deserialize)]
pub struct FixedFrame {
    parent: String,
    child: String,
    translation: [f64; 3],
    rotation: [f64; 4],
}

impl Time {
    pub fn now() -> Time {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).expect("a clock after 1970");
        Time { sec: since.as_secs() as i32, nanosec: since.subsec_nanos() }
    }
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Vector3 {
        Vector3 { x, y, z }
    }
}

impl From<[f64; 4]> for Quaternion {
    fn from([x, y, z, w]: [f64; 4]) -> Quaternion {
        Quaternion { x, y, z, w }
    }
}

impl PointCloud2 {
    pub fn set_points(&mut self, data: Vec<u8>) {
        assert!(data.len() % POINT_STEP == 0, "whole points");
        self.width = (data.len() / POINT_STEP) as u32;
        self.row_step = data.len() as u32;
        self.data = data;
    }
}

/// An empty cloud in a frame.
pub fn cloud_of(frame_id: &str) -> PointCloud2 {
    let field = |(index, name): (usize, &str)| PointField {
        name: name.to_string(),
        offset: 4 * index as u32,
        datatype: FLOAT32,
        count: 1,
    };
    PointCloud2 {
        header: Header { stamp: Time::now(), frame_id: frame_id.to_string() },
        height: 1,
        width: 0,
        fields: ["x", "y", "z", "intensity"].into_iter().enumerate().map(field).collect(),
        is_bigendian: false,
        point_step: POINT_STEP as u32,
        row_step: 0,
        data: Vec::new(),
        is_dense: true,
    }
}

/// A sample of an IMU that gives no orientation, as its covariance's first number says.
pub fn sample_of(frame_id: &str) -> Imu {
    Imu {
        header: Header { stamp: Time::now(), frame_id: frame_id.to_string() },
        orientation: [0.0, 0.0, 0.0, 1.0].into(),
        orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        angular_velocity: [0.0; 3].into(),
        angular_velocity_covariance: [0.0; 9],
        linear_acceleration: [0.0; 3].into(),
        linear_acceleration_covariance: [0.0; 9],
    }
}

pub fn fixed_frames(frames: &[FixedFrame]) -> TFMessage {
    let transforms = frames
        .iter()
        .map(|frame| TransformStamped {
            header: Header { stamp: Time::now(), frame_id: frame.parent.clone() },
            child_frame_id: frame.child.clone(),
            transform: Transform { translation: frame.translation.into(), rotation: frame.rotation.into() },
        })
        .collect();
    TFMessage { transforms }
}
