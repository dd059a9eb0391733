// The pose of a scan in a map, found on the robot itself: no service, no Python.
#pragma once

#include <memory>
#include <string>

#include "firstfix/answer/documents.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/errors.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/sequence.hpp"

namespace firstfix {

// A version of a map, memory-mapped: its folder is maps/MAP/versions/VERSION of a store. Its answers are a service's, with the
// same verdict, poses and probabilities. But a service says more, and checks more: see `localize`. Threads may share it.
class Localizer {
 public:
  // As TemplateSearch, of more files.
  explicit Localizer(const std::string& folder);
  ~Localizer();
  Localizer(Localizer&&) noexcept;
  Localizer& operator=(Localizer&&) noexcept;

  // Name of the version: the manifest's sha256.
  const std::string& version() const;

  // The sensor's pose in the map, or the reason why there is none. Of the findings, the answer has the one that says its reason. It
  // has no hint, no facts of the scan and no fix_id. It is right for scans that were taken from their own origin, as a sensor gives
  // them: a service refuses others as wrong_frame. T_odom_base and version of the options change nothing.
  //
  // Throws Error "invalid_scan", "too_large", or "invalid_option" with a service's limits and messages, as for a
  // max_false_accept that the map cannot promise.
  Localization localize(const Scan& scan, const LocalizeOptions& options = {}) const;
  Localization localize(const CompactScan& scan, const LocalizeOptions& options = {}) const;

  // The pose of the last scan of several. gravity and twist are those of the last one.
  Localization localize(const ScanSequence& sequence, const LocalizeOptions& options = {}) const;

 private:
  struct Opened;
  std::unique_ptr<const Opened> opened_;
};

}  // namespace firstfix
