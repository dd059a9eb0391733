// The pose of a scan in a map, found on the robot itself: no service, no Python.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "firstfix/answer/documents.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/errors.hpp"
#include "firstfix/query/deadline.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/sequence.hpp"

namespace firstfix {

// A map on board: the id by which answers name it, and its version's folder, which is maps/MAP/versions/VERSION of a store.
struct MapFolder {
  std::string map_id, folder;
};

// Versions of one map or several, memory-mapped. Its answers are a service's, with the same verdict, poses, probabilities and findings.
// Threads may share it.
class Localizer {
 public:
  // How long other forms of a scan that is not localized may be tried, to say why, over the time that its query has taken.
  static constexpr double kExplaining = 4;

  // Opens a version as TemplateSearch does, of more files. explaining: kExplaining or another share; 0: no other form is tried.
  explicit Localizer(const std::string& folder, double explaining = kExplaining);

  // Opens 1 to 16 maps. A scan is then localized in all of them at once: their places compete on equal terms, and the answer names the
  // map whose frame its pose is in.
  explicit Localizer(const std::vector<MapFolder>& maps, double explaining = kExplaining);
  ~Localizer();
  Localizer(Localizer&&) noexcept;
  Localizer& operator=(Localizer&&) noexcept;

  // Name of the version, of several maps the first one's: the manifest's sha256.
  const std::string& version() const;

  // The sensor's pose in the map, or the reason why there is none, with facts of the scan and findings. It has no hint and no fix_id.
  // T_odom_base and version of the options change nothing.
  //
  // Throws Error "invalid_scan", "too_large", or "invalid_option" with a service's limits and messages, as for a
  // max_false_accept that a map cannot promise, or a prior where there are several maps. Once another thread cancels the query, it
  // ends within some milliseconds with Error "query_cancelled":
  //
  //     std::atomic<std::uint64_t> cancelled{0};
  //     localizer.localize(scan, options, {cancelled, 1});  // until another thread says: cancelled = 1
  Localization localize(const Scan& scan, const LocalizeOptions& options = {}, const Cancellation& cancellation = {}) const;
  Localization localize(const CompactScan& scan, const LocalizeOptions& options = {}, const Cancellation& cancellation = {}) const;

  // The pose of the last scan of several. gravity and twist are those of the last one.
  Localization localize(const ScanSequence& sequence, const LocalizeOptions& options = {}, const Cancellation& cancellation = {}) const;

 private:
  struct Opened;
  std::unique_ptr<const Opened> opened_;
};

}  // namespace firstfix
