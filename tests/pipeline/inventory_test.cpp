#include "pipeline/inventory.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace granary {
namespace {

Measurement Measured(double volume_m3) {
  Measurement m;
  m.valid = true;
  m.reason = Reason::kOk;
  m.volume_m3 = volume_m3;
  return m;
}

/// The paper's box, 0.019 m³, of wheat at 790 kg/m³: 15.01 kg.
Inventory Wheat(double book_mass_kg) {
  Inventory inventory;
  inventory.book_mass_kg = book_mass_kg;
  inventory.density_kg_m3 = 790;
  return inventory;
}

TEST(ApplyInventory, FollowsThePaperFromVolumeToErrorRate) {
  Measurement m = Measured(0.019);
  Inventory inventory = Wheat(15.2);
  inventory.correction = 1.02;
  inventory.loss_kg = 0.1;
  ApplyInventory(m, inventory);
  EXPECT_DOUBLE_EQ(*m.density_kg_m3, 790);
  EXPECT_DOUBLE_EQ(*m.correction, 1.02);
  EXPECT_DOUBLE_EQ(*m.loss_kg, 0.1);
  EXPECT_DOUBLE_EQ(*m.book_mass_kg, 15.2);
  EXPECT_NEAR(*m.mass_kg, 15.3102, 1e-9);  // 0.019 · 1.02 · 790, rounding only
  EXPECT_NEAR(*m.mass_check_kg, 15.4102, 1e-9);
  EXPECT_NEAR(*m.error_rate_percent, (15.4102 - 15.2) / 15.2 * 100, 1e-9);  // 1.38 %
  EXPECT_FALSE(*m.abnormal);
}

TEST(ApplyInventory, CallsMoreThanThreePercentAbnormalOnEitherSide) {
  for (const auto& [book_kg, abnormal] :
       {std::pair{15.01 / 1.031, true}, {15.01 / 1.029, false}, {15.01 / 0.971, false}, {15.01 / 0.969, true}}) {
    Measurement m = Measured(0.019);
    ApplyInventory(m, Wheat(book_kg));
    EXPECT_EQ(*m.abnormal, abnormal) << *m.error_rate_percent;
  }
}

TEST(ApplyInventory, CountsAMissingQuantityNegative) {
  Measurement m = Measured(0.019);
  ApplyInventory(m, Wheat(30.02));
  EXPECT_NEAR(*m.error_rate_percent, -50, 1e-9);
}

TEST(ApplyInventory, DerivesUncertaintyFromTheVolume) {
  Measurement m = Measured(0.019);
  m.volume_u95_m3 = 0.00019;  // 1 %
  ApplyInventory(m, Wheat(15.01));
  EXPECT_NEAR(*m.error_rate_u95_percent, 1, 1e-9);
}

TEST(ApplyInventory, AddsTheUncertaintyOfTheDensityInQuadrature) {
  Measurement m = Measured(0.019);
  m.volume_u95_m3 = 0.03 * 0.019;
  Inventory inventory = Wheat(15.01);
  inventory.density_u95_percent = 4;
  ApplyInventory(m, inventory);
  EXPECT_NEAR(*m.error_rate_u95_percent, 5, 1e-9);
}

TEST(ApplyInventory, LeavesTheUncertaintyEmptyWhenThatOfTheVolumeIsUnknown) {
  Measurement m = Measured(0.019);
  Inventory inventory = Wheat(15.01);
  inventory.density_u95_percent = 4;
  ApplyInventory(m, inventory);
  EXPECT_TRUE(m.error_rate_percent);
  EXPECT_FALSE(m.error_rate_u95_percent);
}

TEST(ApplyInventory, LeavesMassesEmptyWithoutADensity) {
  for (const std::optional<double> density : {std::optional<double>{}, {0.0}, {-1.0}, {std::nan("")}}) {
    Measurement m = Measured(0.019);
    Inventory inventory = Wheat(15.01);
    inventory.density_kg_m3 = density;
    ApplyInventory(m, inventory);
    EXPECT_FALSE(m.density_kg_m3 || m.mass_kg || m.mass_check_kg || m.error_rate_percent || m.abnormal);
    EXPECT_TRUE(m.book_mass_kg);
  }
}

TEST(ApplyInventory, LeavesMassesEmptyWithoutAUsableCorrection) {
  for (const double correction : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    Measurement m = Measured(0.019);
    Inventory inventory = Wheat(15.01);
    inventory.correction = correction;
    ApplyInventory(m, inventory);
    EXPECT_FALSE(m.correction || m.mass_kg || m.error_rate_percent);
  }
}

TEST(ApplyInventory, LeavesTheCheckEmptyWhenTheLossIsNotANumber) {
  Measurement m = Measured(0.019);
  Inventory inventory = Wheat(15.01);
  inventory.loss_kg = std::nan("");
  ApplyInventory(m, inventory);
  EXPECT_TRUE(m.mass_kg);
  EXPECT_FALSE(m.loss_kg || m.mass_check_kg || m.error_rate_percent);
}

TEST(ApplyInventory, LeavesTheErrorRateEmptyWithoutABookQuantity) {
  for (const std::optional<double> book : {std::optional<double>{}, {0.0}, {-5.0}}) {
    Measurement m = Measured(0.019);
    Inventory inventory = Wheat(1);
    inventory.book_mass_kg = book;
    ApplyInventory(m, inventory);
    EXPECT_TRUE(m.mass_check_kg);
    EXPECT_FALSE(m.book_mass_kg || m.error_rate_percent || m.error_rate_u95_percent || m.abnormal);
  }
}

TEST(ApplyInventory, ComparesAnEmptyBinWithItsBooks) {
  Measurement m = Measured(0);
  m.volume_u95_m3 = 0.0001;
  ApplyInventory(m, Wheat(15.01));
  EXPECT_DOUBLE_EQ(*m.mass_kg, 0);
  EXPECT_DOUBLE_EQ(*m.error_rate_percent, -100);
  EXPECT_NEAR(*m.error_rate_u95_percent, 0.079 / 15.01 * 100, 1e-9);
}

TEST(ApplyInventory, EmptiesEverythingOfAnInvalidMeasurement) {
  Measurement m = Measured(0.019);
  ApplyInventory(m, Wheat(15.01));
  m.valid = false;
  ApplyInventory(m, Wheat(15.01));
  EXPECT_FALSE(m.density_kg_m3 || m.correction || m.loss_kg || m.mass_kg || m.mass_check_kg || m.book_mass_kg ||
               m.error_rate_percent || m.error_rate_u95_percent || m.abnormal);
}

TEST(ApplyInventory, EmptiesEverythingWithoutAVolume) {
  Measurement m = Measured(0);
  m.volume_m3.reset();
  ApplyInventory(m, Wheat(15.01));
  EXPECT_FALSE(m.mass_kg || m.error_rate_percent || m.abnormal);
}

}  // namespace
}  // namespace granary
