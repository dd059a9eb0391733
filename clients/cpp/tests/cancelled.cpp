// firstfix_cancelled FOLDER FILE: queries of a localizer that are cancelled before they begin or while they run, and others between
// them that share their word. Prints how each ended: an error's code, or a verdict with its probability.
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <thread>
#include <variant>

#include "../examples/scan_file.hpp"
#include "firstfix/version/localizer.hpp"

namespace {

template <class Sent>
void localize(const firstfix::Localizer& localizer, const Sent& scan, const firstfix::Cancellation& cancellation) {
  try {
    const firstfix::Localization fix = localizer.localize(scan, {}, cancellation);
    std::printf("%s %.17g\n", firstfix::text_of(fix.verdict), fix.probability);
  } catch (const firstfix::Error& error) {
    std::printf("%s\n", error.code().c_str());
  }
}

// Until another thread cancels it: as often as it takes.
template <class Sent>
void localize_until_cancelled(const firstfix::Localizer& localizer, const Sent& scan) {
  std::atomic<std::uint64_t> cancelled{0};
  std::atomic<bool> has_begun{false};
  std::thread other([&] {
    while (!has_begun) std::this_thread::yield();
    cancelled = 1;
  });
  try {
    for (;;) {
      has_begun = true;
      localizer.localize(scan, {}, {cancelled, 1});
    }
  } catch (const firstfix::Error& error) {
    std::printf("%s\n", error.code().c_str());
  }
  other.join();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const firstfix::Localizer localizer({{"one", argv[1]}, {"other", argv[1]}});
  std::visit(
      [&](const auto& scan) {
        std::atomic<std::uint64_t> cancelled{1};
        localize(localizer, scan, {});
        localize(localizer, scan, {cancelled, 1});
        localize(localizer, scan, {cancelled, 2});
        localize_until_cancelled(localizer, scan);
        localize(localizer, scan, {});
      },
      firstfix::example::read_scans(argv[2]));
  return 0;
}
