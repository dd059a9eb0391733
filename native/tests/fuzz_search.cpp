// The search for a query's poses, on maps, scans and candidates that hold any numbers.
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "firstfix/query/search.hpp"
#include "hostile.hpp"
#include "random_map.hpp"

namespace firstfix::tests {
namespace {

void check(const Search& search) {
  const RegisteredPoses& found = search.found();
  for (std::size_t i = 0; i < found.size(); ++i) {
    const RegisteredPose& one = found[i];
    expect(std::isfinite(one.support), "a support");
    expect(i == 0 || found[i - 1].support >= one.support, "best first");
    expect(one.fit.inlier_ratio >= 0 && one.fit.inlier_ratio <= 1, "inlier ratio within 0 and 1");
    expect(one.is_measured, "every agreement is measured");
  }
}

void decide(Hostile& random, const SearchedMap& map, const Search& search) {
  std::vector<Competitor> ranked;
  for (const RegisteredPose& one : search.found()) {
    const auto spots = static_cast<std::size_t>(random.number(1, 4));
    const double outside_lead = random.chance(0.2) ? random.real(1, 0) : 0;
    ranked.push_back({0, one.fit, one.support, spots, one.is_alike, outside_lead, one.registration.rests,
                      is_in_motion(one.registration)});
  }
  const std::vector<JudgingMap> maps{{map.ranking, map.calibration}};
  const Decision found = Judge(maps, ranked).decided(random.real(1));
  expect(found.shares.size() == ranked.size(), "one share for each pose");
  for (const double share : found.shares) expect(share >= -1e-9 && share <= 1 + 1e-9, "a share within 0 and 1");
}

void search_once(Hostile& random) {
  const double wrong = random.chance(0.5) ? 0.1 : 0;
  const RandomMap tables(random, wrong);
  const bool in_time = random.chance(0.3);
  const auto count = static_cast<std::size_t>(random.number(0, 120));
  SearchedQuery query{{}, surface(random, count, in_time, 0), surface(random, count / 2, in_time, 0), 1};
  if (count < 2 && in_time) return;  // a scan with times has points
  ViewedScan scan{pose(random, 0), {std::vector<std::uint8_t>(kDirections, 1), std::vector<float>(kDirections, 5.0F)}, {}};
  if (in_time) scan.returns = query.dense.at;
  query.scans.push_back(scan);
  std::optional<PriorRegion> prior;
  if (random.chance(0.3)) prior = PriorRegion{pose(random, 0), {random.real(4, 0), 0, 0}, 5, random.real(180, 0), 90};
  Search search(tables.map, query, prior);
  std::vector<Candidate> candidates;
  for (int run = 0; run < 3; ++run) {
    candidates.clear();
    std::vector<PoseMatrix> aliases;
    for (std::int64_t i = random.number(0, 8); i > 0; --i) {
      candidates.push_back({i, pose(random, 0), random.real(1, 0)});
      aliases.push_back(pose(random, 0));
    }
    KnownTwist twist;
    if (random.chance(0.3)) twist = Vector6{1, 0, 0, 0, 0, 0.5};
    search.run(candidates, twist, aliases);
    check(search);
    search.search_near();
    check(search);
    expect(search.rivals(candidates, 0.5).size() <= candidates.size(), "rows of the aliases");
    search.leaves_out(aliases);
    search.is_settled();
    search.explains_scan();
    StageTimes times;
    search.try_aliases(search.needed(random.real(1)), random.chance(0.5), times);
    search.mark_look_alikes();
    check(search);
    decide(random, tables.map, search);
    expect(prior || search.aliases_outside().empty(), "nothing is outside where there is no prior");
    for (const Candidate& one : search.aliases_outside()) expect(!prior->allows(one.T_level_sensor), "an alias outside");
    expect(search.found().empty() || search.lead_outside(search.found()) == 0, "what the prior allows is not outside");
  }
  for (const std::int64_t row : search.untried(candidates, std::nullopt)) {
    expect(row >= 0 && row < static_cast<std::int64_t>(candidates.size()), "a row of the candidates");
  }
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::search_once(random);
  }
}
