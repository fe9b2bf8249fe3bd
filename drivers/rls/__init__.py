"""Driver of RLS Orbis and AksIM encoders, each on its own serial port."""
