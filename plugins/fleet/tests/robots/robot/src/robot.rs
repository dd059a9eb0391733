//! The robot's node: what it publishes, what it hears, and its client of the service.

use std::collections::{BTreeMap, VecDeque};
use std::net::Ipv4Addr;

use futures::executor::block_on;
use futures::FutureExt;
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use ros2_client::service::Client;
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, RmwRequestId, ServiceMapping,
    ServiceTypeName,
};
use rustdds::DomainParticipantBuilder;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{json, Value};

use crate::messages::*;
use crate::sensors::{cloud_of, fixed_frames, sample_of, FixedFrame};

const RELIABLE: Reliability = Reliability::Reliable { when_full: WhenFull::DEFAULT };

/// Options of a robot: it uses no other network than that of the address, and `namespace` has a leading slash.
///
/// `reliable_clouds` is false for the quality of service of sensor data; `service_mapping` is how the robot's
/// middleware carries the identity of a request: "cyclone" or "enhanced" (Fast DDS, Connext).
#[derive(Deserialize)]
pub struct Options {
    domain: u16,
    network: Ipv4Addr,
    namespace: String,
    reliable_clouds: bool,
    service_mapping: String,
    sensor_frame: String,
    imu_frame: String,
    frames: Vec<FixedFrame>,
}

pub struct Robot {
    node: Node,
    clouds: Publisher<PointCloud2>,
    samples: Publisher<Imu>,
    _frames: Publisher<TFMessage>, // keeps the frames for those who come late
    client: Client<TriggerRequest, TriggerResponse>,
    heard: Vec<Box<dyn FnMut() -> Option<Value>>>,
    found_service: bool,
    wanted_calls: VecDeque<i64>,
    open_calls: BTreeMap<RmwRequestId, i64>,
    cloud: PointCloud2,
    sample: Imu,
    shows: bool,
}

impl Robot {
    pub fn new(options: &Options) -> Robot {
        let builder = DomainParticipantBuilder::new(options.domain).with_only_networks([options.network]);
        let participant = builder.build().expect("a DDS participant");
        let context = Context::from_domain_participant(participant).expect("a context");
        let name = NodeName::new(&options.namespace, "robot").expect("a namespace");
        let without_extras = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut node = context.new_node(name, without_extras).expect("a node");
        let spinner = node.spinner().expect("a spinner");
        std::thread::spawn(move || block_on(spinner.spin()));

        let mut at = Endpoints { node: &mut node, namespace: &options.namespace };
        let sensor_data = if options.reliable_clouds { RELIABLE } else { Reliability::BestEffort };
        let clouds =
            at.publisher("points", "sensor_msgs/PointCloud2", &qos(sensor_data, Durability::Volatile, 5));
        let best_effort = qos(Reliability::BestEffort, Durability::Volatile, 5);
        let samples = at.publisher("imu", "sensor_msgs/Imu", &best_effort);
        let latched = qos(RELIABLE, Durability::TransientLocal, 1);
        let frames: Publisher<TFMessage> = at.publisher("tf_static", "tf2_msgs/TFMessage", &latched);
        frames.publish(fixed_frames(&options.frames)).expect("published frames");
        let pose = "geometry_msgs/PoseWithCovarianceStamped";
        let heard = vec![
            at.listen::<PoseWithCovarianceStamped>("initialpose", pose),
            at.listen::<PoseWithCovarianceStamped>("first_fix/pose", pose),
            at.listen::<PoseArray>("first_fix/hypotheses", "geometry_msgs/PoseArray"),
            at.listen::<DiagnosticArray>("first_fix/status", "diagnostic_msgs/DiagnosticArray"),
            at.listen::<TFMessage>("tf", "tf2_msgs/TFMessage"),
        ];
        let client = at.client("first_fix/relocalize", &options.service_mapping);
        Robot {
            node,
            clouds,
            samples,
            _frames: frames,
            client,
            heard,
            found_service: false,
            wanted_calls: VecDeque::new(),
            open_calls: BTreeMap::new(),
            cloud: cloud_of(&options.sensor_frame),
            sample: sample_of(&options.imu_frame),
            shows: false,
        }
    }

    /// From now on, the sensors see this.
    pub fn show(&mut self, points: &str, acceleration: [f64; 3]) {
        self.cloud.set_points(std::fs::read(points).expect("a file of points"));
        self.sample.linear_acceleration = acceleration.into();
        self.shows = true;
    }

    pub fn call(&mut self, number: i64) {
        self.wanted_calls.push_back(number);
    }

    pub fn publish_sample(&mut self) {
        if self.shows {
            self.sample.header.stamp = Time::now();
            let _ = self.samples.publish(self.sample.clone()); // best effort
        }
    }

    pub fn publish_cloud(&mut self) {
        if self.shows {
            self.cloud.header.stamp = Time::now();
            if let Err(error) = self.clouds.publish(self.cloud.clone()) {
                say(json!({"event": "not published", "why": format!("{error}")}));
            }
        }
    }

    /// Says what has come, and makes the calls that wait for the service.
    pub fn hear(&mut self) {
        for take in &mut self.heard {
            while let Some(event) = take() {
                say(event);
            }
        }
        while let Ok(Some((id, response))) = self.client.receive_response() {
            // A response to another client of the same service comes here, too.
            if let Some(number) = self.open_calls.remove(&id) {
                say(json!({"event": "response", "call": number, "message": response}));
            }
        }
        if !self.found_service && self.client.wait_for_service(&self.node).now_or_never().is_some() {
            self.found_service = true;
            say(json!({"event": "service"}));
        }
        while self.found_service && !self.wanted_calls.is_empty() {
            let number = self.wanted_calls.pop_front().expect("a call");
            let id = self.client.send_request(TriggerRequest::default()).expect("a sent request");
            self.open_calls.insert(id, number);
        }
    }
}

/// Makes the endpoints of a node, in its namespace.
struct Endpoints<'a> {
    node: &'a mut Node,
    namespace: &'a str,
}

impl Endpoints<'_> {
    fn publisher<M: Serialize>(&mut self, name: &str, of_type: &str, qos: &QosProfile) -> Publisher<M> {
        let topic = self.node.create_topic(&self.name(name), type_name(of_type), qos).expect("a topic");
        self.node.create_publisher(&topic, None).expect("a publisher")
    }

    fn listen<M: Serialize + DeserializeOwned + 'static>(
        &mut self,
        name: &str,
        of_type: &str,
    ) -> Box<dyn FnMut() -> Option<Value>> {
        let usual = qos(RELIABLE, Durability::Volatile, 10);
        let topic = self.node.create_topic(&self.name(name), type_name(of_type), &usual).expect("a topic");
        let subscription = self.node.create_subscription::<M>(&topic, None).expect("a subscription");
        let name = name.to_string();
        Box::new(move || match subscription.take() {
            Ok(taken) => taken.map(|(message, _)| json!({"event": name, "message": message})),
            Err(error) => Some(json!({"event": "unreadable", "topic": name, "why": format!("{error}")})),
        })
    }

    fn client(&mut self, name: &str, mapping: &str) -> Client<TriggerRequest, TriggerResponse> {
        let mapping = match mapping {
            "cyclone" => ServiceMapping::Cyclone,
            "enhanced" => ServiceMapping::Enhanced,
            other => panic!("no such mapping of services: {other}"),
        };
        let usual = qos(RELIABLE, Durability::Volatile, 10);
        let trigger = ServiceTypeName::new("std_srvs", "Trigger");
        self.node.create_client(mapping, &self.name(name), &trigger, usual.clone(), usual).expect("a client")
    }

    fn name(&self, name: &str) -> Name {
        Name::parse(&format!("{}/{name}", self.namespace)).expect("a name")
    }
}

fn type_name(name: &str) -> MessageTypeName {
    let (package, name) = name.split_once('/').expect("package/Name");
    MessageTypeName::new(package, name)
}

fn qos(reliability: Reliability, durability: Durability, depth: usize) -> QosProfile {
    QosProfile::default().reliability(reliability).durability(durability).history(History::KeepLast { depth })
}

fn say(mut event: Value) {
    event["time"] = json!(Time::now());
    println!("{event}");
}
