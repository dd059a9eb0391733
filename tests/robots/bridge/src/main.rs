//! A zenoh-DDS bridge: `bridge CONFIG.json5`, with the plugin's options under `plugins: {ros2dds: {...}}`.

use zenoh::config::Config;
use zenoh::internal::plugins::PluginsManager;
use zenoh::internal::runtime::RuntimeBuilder;

#[tokio::main]
async fn main() {
    zenoh::init_log_from_env_or("z=info");
    let path = std::env::args().nth(1).expect("the path of a configuration");
    let config = Config::from_file(path).expect("a configuration of zenoh");
    let mut plugins = PluginsManager::static_plugins_only();
    plugins.declare_static_plugin::<zenoh_plugin_ros2dds::ROS2Plugin, &str>("ros2dds", true);
    let mut runtime =
        RuntimeBuilder::new(config).plugins_manager(plugins).build().await.expect("a zenoh runtime");
    runtime.start().await.expect("a started runtime");
    tokio::signal::ctrl_c().await.expect("a signal");
}
