// The HTTP client: asks a running service for a fix.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firstfix/answer/documents.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/answer/robot_name.hpp"
#include "firstfix/scan/condense.hpp"
#include "firstfix/wire/query.hpp"
#include "firstfix/wire/scan.hpp"
#include "firstfix/wire/sequence.hpp"

namespace firstfix {

// Retries wait a random time. Its upper limit doubles with every attempt. A wait that the service asks for is kept.
struct RetryPolicy {
  int attempts = 5;  // including the first; 1 turns retries off
  double first_wait_s = 0.1, max_wait_s = 2.0;
};

enum class Encoding {
  scan,         // the whole scan
  range_image,  // the whole scan in a ninth to a third of the bytes
  compact,      // under 10 KB; answered as well as the whole scan
  descriptor,   // under 1.5 KB; answered with candidates, never localized
};

struct Settings {
  double timeout_s = 10;  // of a whole call, including retries
  RetryPolicy retry;
  std::optional<double> resolution_m;  // of whole scans; default 1 cm, for range images 2.5 cm
  std::optional<double> voxel_m;       // of whole scans: send only the first point of each voxel
  std::optional<std::string> api_key;  // default: the variable FIRSTFIX_API_KEY, if it is set
  std::string ca_file;                 // trusted certificates; default: the system's
};

// Exactly one of the two is present.
struct GeoAnswer {
  std::optional<GeoPose> pose;                // if localized
  std::optional<Localization> not_localized;  // if not
};

// Asks a firstfix service over HTTP. Thread-safe. Connections are kept between calls. Redirects are not followed.
//
// Every call ends within its timeout. All calls may throw Error with the service's own code, "deadline_exceeded" when
// the timeout is over, "unreachable" if no attempt reached a service, and "unreadable" if the answer is not from a
// firstfix service.
class Client {
 public:
  // Throws "invalid_option" for an invalid URL, key or setting.
  explicit Client(const std::string& url, Settings settings = {});
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // Localizes a scan in a map. Points that are not finite or beyond 1000 m are left out.
  //
  // A descriptor needs the map's descriptor parameters. They are fetched once, and again when the map changes.
  //
  // All queries may carry the robot's name, for people who watch the answers of robots that share a key or an address.
  // Throws "invalid_option" for a name of another form.
  Localization localize(const Scan& scan, const std::string& map_id, const LocalizeOptions& options = {},
                        Encoding encoding = Encoding::scan, const RobotName& robot = {});

  // Localizes the last of several scans.
  Localization localize(const ScanSequence& sequence, const std::string& map_id, const LocalizeOptions& options = {},
                        const RobotName& robot = {});

  // Sends a query that is already encoded. The bytes are not changed.
  Localization localize_body(const Bytes& body, const std::string& media_type, const std::string& map_id,
                             const LocalizeOptions& options = {}, const RobotName& robot = {});

  // Localizes a scan in geographic coordinates. Throws "not_acceptable" if the map has no georeference.
  GeoAnswer geopose(const Scan& scan, const std::string& map_id, const LocalizeOptions& options = {},
                    const RobotName& robot = {});

  // Descriptor parameters of the map's active version.
  DescriptorParameters descriptor_parameters(const std::string& map_id);

  // All maps of the service.
  std::vector<MapInfo> maps();

 private:
  class Http;
  struct Parameters;
  Localization localize_described(const Scan& scan, const std::string& map_id, const LocalizeOptions& options,
                                  const RobotName& robot, bool* known);

  Settings settings_;
  std::unique_ptr<Http> http_;
  std::unique_ptr<Parameters> parameters_;
};

// Encodes a compact query in under 10 KB. A scan that needs more bytes is sent with fewer points.
Bytes compact_body(CompactScan scan);

}  // namespace firstfix
