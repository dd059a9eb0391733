#include "firstfix/version/template_search.hpp"

#include "checked_options.hpp"
#include "poses.hpp"
#include "sent_query.hpp"
#include "template_tables.hpp"
#include "version_folder.hpp"

namespace firstfix {

struct TemplateSearch::Opened {
  explicit Opened(const version::VersionFolder& folder) : version(folder.version()), templates(folder) {}

  std::string version;
  version::TemplateTables templates;
};

TemplateSearch::TemplateSearch(const std::string& folder) : opened_(std::make_unique<Opened>(version::VersionFolder(folder))) {}
TemplateSearch::~TemplateSearch() = default;
TemplateSearch::TemplateSearch(TemplateSearch&&) noexcept = default;
TemplateSearch& TemplateSearch::operator=(TemplateSearch&&) noexcept = default;

const std::string& TemplateSearch::version() const { return opened_->version; }

std::vector<SimilarPlace> TemplateSearch::find(const Scan& scan, const PlacesOptions& asked) const {
  const PlacesOptions options = version::checked(asked);
  const version::EngineNumbers& numbers = opened_->templates.numbers;
  const auto prepared = version::prepared(version::sent(scan), options, numbers);
  if (!prepared) return {};
  const QueriedScan queried = prepared->queried(&numbers.grid).front();
  const LevelledScan levelled{0, queried.measured.R_level_sensor, queried.height_m, true};
  const Wanted wanted{options.max_places.value_or(numbers.effort.candidates), numbers.effort.clusters};
  const version::TemplateTables& templates = opened_->templates;
  const auto prior = version::region_of(options.prior, numbers.T_map_level);
  const FindTemplates find = templates.describe()(queried, levelled);
  std::vector<SimilarPlace> places;
  for (const Candidate& one :
       similar_places(templates.places(), numbers.spacing_m, find, version::kSameFrame, levelled, prior, wanted)) {
    places.push_back({version::product(numbers.T_map_level, one.T_level_sensor), one.score, one.template_row});
  }
  return places;
}

}  // namespace firstfix
