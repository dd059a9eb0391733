// The HTTP client: a fix from a running service, as a typed answer.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "answer.hpp"
#include "condense.hpp"
#include "options.hpp"
#include "wire.hpp"
#include "wire_query.hpp"
#include "wire_sequence.hpp"

namespace firstfix {

// When to try again: random waits whose longest doubles from try to try, never less than the service asks for.
struct RetryPolicy {
  int attempts = 5;  // the first included; 1 turns retries off
  double first_wait_s = 0.1, max_wait_s = 2.0;
};

enum class Encoding {
  scan,         // all of it
  range_image,  // all of it in a ninth to a third of the bytes
  compact,      // under 10 KB, and answered as well
  descriptor,   // under 1.5 KB, and answered with candidates, never localized
};

struct Settings {
  double timeout_s = 10;  // of a call as a whole, retries included
  RetryPolicy retry;
  std::optional<double> resolution_m;  // of whole scans; none: 1 cm, of range images 2.5 cm
  std::optional<double> voxel_m;       // of whole scans: only the first point of each cube
  std::optional<std::string> api_key;  // none: FIRSTFIX_API_KEY of the environment, if it is there
  std::string ca_file;                 // certificates to trust beside the system's none: the system's
};

struct GeoAnswer {
  std::optional<GeoPose> pose;                // where localized
  std::optional<Localization> not_localized;  // where not
};

// Asks a firstfix service over HTTP. Thread-safe; connections are kept between calls, redirects never followed.
//
// Every call ends within its timeout. Besides what is said there, calls throw Error with the service's own code,
// "deadline_exceeded" when the timeout is over, "unreachable" when no try reached a service, and "unreadable" when
// what answered is none.
class Client {
 public:
  // Throws "invalid_option" for a URL, key or setting of no use.
  explicit Client(const std::string& url, Settings settings = {});
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // The pose of a scan in a map, or why there is none. Points that are not finite or beyond 1000 m are left out.
  //
  // A descriptor needs its map's parameters: they are asked for once, and again when the map changes.
  Localization localize(const Scan& scan, const std::string& map_id, const LocalizeOptions& options = {},
                        Encoding encoding = Encoding::scan);

  // Of several scans with the way between them: the pose of the last.
  Localization localize(const ScanSequence& sequence, const std::string& map_id, const LocalizeOptions& options = {});

  // Of a query that is encoded already: the service gets these very bytes.
  Localization localize_body(const Bytes& body, const std::string& media_type, const std::string& map_id,
                             const LocalizeOptions& options = {});

  // As localize, in geographic coordinates. Throws "not_acceptable" where the map has no georeference.
  GeoAnswer geopose(const Scan& scan, const std::string& map_id, const LocalizeOptions& options = {});

  // How scans for the map's active version are described.
  QueryParameters query_parameters(const std::string& map_id);

  std::vector<MapInfo> maps();

 private:
  class Http;
  struct Parameters;
  Localization localize_described(const Scan& scan, const std::string& map_id, const LocalizeOptions& options,
                                  bool* known);

  Settings settings_;
  std::unique_ptr<Http> http_;
  std::unique_ptr<Parameters> parameters_;
};

// A compact query's body, under 10 KB: with fewer points where a scan is so rich that it takes more.
Bytes compact_body(CompactScan scan);

}  // namespace firstfix
